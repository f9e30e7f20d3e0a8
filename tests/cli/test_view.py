"""The page of `taichi-cloth view`: by viser, in a headless browser where there is one, and as a process."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.request

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli
from taichi_cloth.live import server, view
from taichi_cloth.live.page import Page
from taichi_cloth.live.parameters import Parameter
from taichi_cloth.live.seen import Opening
from taichi_cloth.live.session import Session
from taichi_cloth.live.teller import Teller
from taichi_cloth.live.view import Made
from taichi_cloth.options import Options
from taichi_cloth.output.camera import frame

pytest.importorskip("viser", reason="the page needs the extra `view`: pip install viser")
pytestmark = pytest.mark.slow

BROWSER = next((found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None)
SOFTLY = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
CAMERA = tc.Camera((0.5, 0.5, 2.2), (0.5, 0.5, 0.0), 35.0)


def build(settings: dict) -> tc.Scene:
    """A red sheet in front of the camera, which hangs from its upper edge."""
    scene = tc.Scene(view=tc.View(CAMERA, ground=-0.5))
    fabric = tc.Fabric(0.2, tc.Stretch(300, 0.3), tc.Shear(30))
    cloth = scene.add_cloth(tc.grid(1.0, settings["cells"], plane="xy"), fabric, color=(0.8, 0, 0))
    scene.pin(cloth, "top")
    scene.add_prop(tc.Sphere(0.1), position=(0.5, -0.3, 0.0))
    return scene


@contextlib.contextmanager
def opened(source: Made):
    """A session, its page in this process, and the page's address."""
    served, made = server.started(server.HOST, server.free_port(server.HOST, None)), []

    def send(message) -> None:
        if isinstance(message, Opening):
            made.append(Page(served, message, session.ask))
        else:
            made[0].show(message)
            teller.shown(session)

    teller = Teller("sheet", send)
    session = Session(source, teller)
    teller(session)
    session.begin(plays=False)
    yield session, made[0], server.address_of(server.HOST, served.get_port())
    session.end()
    server.stop(served)


@pytest.fixture
def shown():
    with opened(Made(build, Options(h=1 / 60), (Parameter("cells", 8, (2, 20)),))) as made:
        yield made


def turns(session: Session, seconds: float = 60.0, until=lambda: False) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not until():
        session.turn()


def cloth_on(page: Page) -> np.ndarray:
    """Rows of all triangles of cloth that the page shows, sorted."""
    visible = [m for name, m in page.meshes.items() if name.startswith("cloth") and m.visible]
    return np.sort(np.concatenate([m.vertices[m.faces] for m in visible]).reshape(-1, 9), axis=0)


def test_the_page_has_the_cloth_and_follows_it(shown):
    session, page, address = shown
    assert urllib.request.urlopen(address, timeout=20).status == 200

    def cloth() -> np.ndarray:
        x = session.sim.positions().astype(np.float32)
        return np.sort(x[session.sim.faces()].reshape(-1, 9), axis=0)

    assert np.array_equal(cloth_on(page), cloth())
    for name, call in (("step", session.step), ("heat", lambda: session.color_by("speed")), ("step", session.step),
                       ("other mesh", lambda: session.set("cells", 6)), ("look", lambda: session.color_by(""))):
        session.orders.put(call)
        session.turn()
        assert np.array_equal(cloth_on(page), cloth()) and session.trouble == "", name
    assert [m.color for n, m in page.meshes.items() if n.startswith("cloth") and m.visible][0][1:] == (0, 0)
    x = session.sim.positions()
    session.orders.put(lambda: session.grab(x[10]))
    session.orders.put(lambda: session.drag(x[10] + [0, 0, 0.3]))
    session.turn()
    assert page.thread.visible and np.allclose(page.thread.points[0], [x[10], x[10] + [0, 0, 0.3]], atol=1e-6)
    session.orders.put(session.drop)
    session.turn()
    assert not page.thread.visible


def test_a_browser_shows_the_cloth_and_changes_it(shown):
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="a browser is led by playwright: pip install playwright")
    session, _, address = shown
    with playwright.sync_playwright() as started, started.chromium.launch(executable_path=BROWSER, args=SOFTLY) as browser:
        tab = browser.new_page(viewport={"width": 760, "height": 440})
        tab.set_default_timeout(60_000)
        tab.goto(address)
        tab.wait_for_selector("canvas")
        turns(session, 20, lambda: redness(tab, project(tab, [0.5, 0.5, 0.0])) > 2.0)
        assert redness(tab, project(tab, [0.5, 0.5, 0.0])) > 2.0 > 1.2 > redness(tab, project(tab, [1.2, 0.5, 0.0]))
        box = next(b for b in tab.locator("input[type=text]").all() if b.input_value() == "8")
        box.fill("12")
        box.press("Enter")
        turns(session, 20, lambda: session.settings["cells"] == 12)
        assert session.sim.vertex_count == 13 * 13
        tab.get_by_role("button", name="Play").click(force=True)
        turns(session, 20, lambda: session.running)
        at = session.sim.positions()
        vertex = int(np.argmin(np.linalg.norm(at - [0.5, 0.3, 0.0], axis=1)))
        x, y = project(tab, at[vertex])
        tab.mouse.move(x, y)
        tab.mouse.down()
        for k in range(1, 6):
            tab.mouse.move(x + 8 * k, y - 4 * k)
            turns(session, 0.2)
        turns(session, 20, lambda: session.hand is not None and
              bool(np.linalg.norm(project(tab, session.hand.place) - [x + 40, y - 20]) < 3))
        hand = session.hand
        assert hand.vertex == vertex and project(tab, hand.place) == pytest.approx([x + 40, y - 20], abs=3)
        turns(session, 20, lambda: project(tab, hand.held_at())[0] > x + 10)
        assert project(tab, hand.held_at())[0] > x + 10  # it follows
        tab.mouse.up()
        turns(session, 20, lambda: session.hand is None)
        tab.get_by_role("button", name="End").click(force=True)
        turns(session, 20, lambda: session.over)
        assert session.over and session.trouble == ""


def test_a_fabric_and_a_wind_are_typed_into_the_page(monkeypatch):
    """A typo is told on the page, and the cloth stays as it is; a name that there is reaches the cloth, which flies."""
    if BROWSER is None:
        pytest.skip("no Chromium is installed")
    playwright = pytest.importorskip("playwright.sync_api", reason="a browser is led by playwright: pip install playwright")
    sources: list[Made] = []
    monkeypatch.setattr(view, "serve", lambda make, *_: sources.append(make()))
    assert cli.main(["view", "hang", "--set", "cells=8", "--set", "fabric=shirting", "--set", "wind=calm"]) == 0
    with (opened(sources[0]) as (session, _, address), playwright.sync_playwright() as started,
          started.chromium.launch(executable_path=BROWSER, args=SOFTLY) as browser):
        tab = browser.new_page(viewport={"width": 760, "height": 700})
        tab.set_default_timeout(60_000)
        tab.goto(address)
        tab.wait_for_selector("canvas")
        turns(session, 20, lambda: "calm" in [b.input_value() for b in tab.locator("input").all()])
        session.step()
        for name, at, wrong, meant in (("fabric", "shirting", "denmi", "denim"), ("wind", "calm", "breze", "breeze")):
            box = next(b for b in tab.locator("input").all() if b.input_value() == at)
            before = session.scene
            box.fill(wrong)
            box.press("Enter")
            tab.get_by_text(f"did you mean '{meant}'").wait_for()  # the session has not even heard of it
            assert session.scene is before and not session.orders.take()
            box.fill(meant)
            box.press("Enter")
            turns(session, 20, lambda name=name, meant=meant: session.settings[name] == meant)
            turns(session, 20, lambda name=name, meant=meant: tab.get_by_text(f"{name}: {meant}, from t = 0.0").count() > 0)
            assert tab.get_by_text(f"{name}: {meant}, from t = 0.0").is_visible()
            turns(session, 20, lambda: tab.get_by_text("did you mean").count() == 0)
            assert tab.get_by_text("did you mean").count() == 0
        assert session.scene.cloths[0].fabric.density == tc.fabrics["denim"].density
        assert session.sim.scene.air.wind_at(0.0).tolist() == [3, 0, 0]


def project(tab, x) -> np.ndarray:
    """(2,) pixel of a point in the tab's picture."""
    box = tab.query_selector("canvas").bounding_box()
    return frame(CAMERA).project(np.array([x], dtype=float), box["width"], box["height"])[0, :2]


def redness(tab, pixel) -> float:
    """Red over green of a pixel on the screen."""
    import io

    image = pytest.importorskip("PIL.Image").open(io.BytesIO(tab.screenshot())).convert("RGB")
    r, g, _ = image.getpixel((round(pixel[0]), round(pixel[1])))
    return r / max(g, 1)


@pytest.mark.skipif(os.name != "posix", reason="signals of other systems are other ones")
def test_the_command_says_where_and_ctrl_c_ends_it_cleanly():
    """Ctrl-C in a terminal reaches the page's process, too."""
    process = start()
    try:
        said = process.stdout.readline()
        address = re.search(r"http://[\w.:]+\d", said)[0]
        assert urllib.request.urlopen(address, timeout=20).status == 200 and "Ctrl-C" in said
        port = int(address.rpartition(":")[2])
        again = subprocess.run([*COMMAND, "--port", str(port)], capture_output=True, text=True, timeout=120, check=False)
        assert again.returncode == 2 and again.stderr.count("\n") == 1 and f"port {port}" in again.stderr
        os.killpg(process.pid, signal.SIGINT)
        ended(process)
    finally:
        process.kill()


@pytest.mark.skipif(os.name != "posix", reason="signals of other systems are other ones")
def test_ctrl_c_may_come_at_any_moment():
    """While Taichi is imported or an object half made, a KeyboardInterrupt became another error, or was lost."""
    for delay in np.linspace(0.0, 1.2, 7):
        process = start()
        try:
            assert process.stdout.readline()
            time.sleep(delay)
            process.send_signal(signal.SIGINT)
            ended(process)
        finally:
            process.kill()


COMMAND = [sys.executable, "-m", "taichi_cloth", "view", "hang", "--set", "cells=4", "--no-open"]


def start() -> subprocess.Popen:
    """The command as the first of a group of processes, which SIGINT ends also where it is ignored."""
    return subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL))


def ended(process: subprocess.Popen) -> None:
    """It ends, with nothing to say but that it was set up, where it came as far as that, and that it ends."""
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0 and error == "", (process.returncode, error)
    assert all(line.startswith(("setting up", "loading or compiling kernels", "ends as soon as")) for line in out.splitlines())
