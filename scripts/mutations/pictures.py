"""One-line bugs in pictures, and the tests that are to notice them."""

PICTURES = "tests/unit/test_pictures.py"
DRAWN = "tests/cli/test_drawn.py"
OUTPUT = "tests/unit/test_output.py"
TESTS = (PICTURES, DRAWN, OUTPUT)
PACKAGE = "taichi_cloth/"
OUT = PACKAGE + "output/"
MUTATIONS = (
    (OUT + "framing.py", "value + max(reach, SPOT)", "value - 9 * max(reach, SPOT)", "the camera comes too near", OUTPUT),
    (OUT + "framing.py", "(most[:, 0] - most[:, 1]) / 2", "(most[:, 0] + most[:, 1]) / 2",
     "the camera looks past the middle", OUTPUT),
    (OUT + "picture.py", "for frame in frames() if frames and (self.fitted or stands) else ():", "for frame in ():",
     "only the first frame is fitted", DRAWN),
    (OUT + "picture.py", "mine = np.where(np.isnan(panels), mine, panels)", "mine = mine",
     "panels have no colours of their own", PICTURES),
    (OUT + "picture.py", "ground=solid if solid <= cloth", "ground=solid if solid <= first[0, 1]",
     "the ground is where cloth comes through it", PICTURES),
    (OUT + "renderer.py", "color = light[..., :3] / np.maximum(part, 1e-6)", "color = light[..., :3]",
     "edges are dark where alpha is",
     PICTURES),
    (OUT + "shade.py", "            alpha = 0.0\n", "            alpha = 1.0\n",
     "a transparent background is black", PICTURES),
    (OUT + "finish.py", "y = s[0] * w - 0.5, (1 - s[1]) * h - 0.5", "y = s[0] * w - 0.5, s[1] * h - 0.5",
     "textures upside down", PICTURES),
    (OUT + "finish.py", "once = objects[o, TEXTURE] > 1.5", "once = objects[o, TEXTURE] > 2.5",
     "textures always repeat", PICTURES),
    (OUT + "finish.py", "row[BOTH] = look.back is None", "row[BOTH] = True", "textures on coloured backs", PICTURES),
    (OUT + "finish.py", "ti.max(ti.log(ti.max(footprint / texel, 1e-6)) * 1.442695, 0.0)",
     "0.0 * footprint", "no means of far textures", PICTURES),
    (OUT + "finish.py", "warp = 2 * x - 1, 2 * y - 1, (i + j) & 1", "warp = 2 * x - 1, 2 * y - 1, i & 0",
     "all threads alike", PICTURES),
    (OUT + "passes.py", "ti.cast(1 / k.sum(), ti.f32)", "ti.cast(k.sum(), ti.f32)", "depth is one over it", PICTURES),
    (OUT + "passes.py", "-t * ray.dot(corner(rows, AXES + 2))", "t", "the ground's depth is along rays", PICTURES),
    (OUT + "passes.py", "owner[f] + 1", "owner[f]", "the first cloth is nothing", PICTURES),
    (OUT + "exr.py", "apart[:-1] + np.uint8(128)", "apart[:-1]", "EXR differences without their middle", PICTURES),
    (OUT + "exr.py", "sorted(channels, key=lambda name: name.encode())", "list(channels)",
     "EXR channels out of order", PICTURES),
    (OUT + "png.py", 'image.astype(">u2")', 'image.astype("<u2")', "16-bit PNG in the wrong byte order", PICTURES),
    (OUT + "smooth.py", "0.375 * (p + q) + 0.125 * across", "0.375 * (p + q) + 0.25 * across",
     "points on edges fly off", PICTURES),
    (OUT + "smooth.py", "np.bincount(faces.ravel(), minlength=n) > 2)", "np.bincount(faces.ravel(), minlength=n) > 0)",
     "corners of sheets are cut", PICTURES),
    (PACKAGE + "scene/view.py", "a, b = h * slope[k], h * slope[k + 1]", "a, b = h * slope[k], 0 * slope[k + 1]",
     "cameras stop at keys", PICTURES),
    (PACKAGE + "recording/drawing.py", "range(low, high + 1, step or 1)", "range(low, high, step or 1)",
     "the last frame is left out",
     PICTURES),
    (PACKAGE + "recording/expected.py", "out.append(start[a.vertices] + max(drop, 0.0) * down)", "pass",
     "a camera that does not foresee that cloth hangs down", PICTURES),
    (PACKAGE + "app/flags.py", 'joined[-1] += "=" + word', "joined.append(word)", "negative numbers are flags", DRAWN),
    (PACKAGE + "colornames.py", "<= 0.04045, encoded / 12.92", "<= 0.04045, encoded / 1.0",
     "dark colours too light", PICTURES),
)
