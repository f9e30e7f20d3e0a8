"""One-line bugs in contact with solids, and the tests that are to notice them."""

CONTACT = "tests/physics/test_solid_contact.py"
FORCES = f"{CONTACT}::test_what_solids_give_is_what_cloth_gets " \
         f"{CONTACT}::test_forces_are_told_after_steps_that_took_more_solves"
RESUME = f"{CONTACT}::test_a_run_is_resumed_in_contact_bit_for_bit"
STICKS = f"{CONTACT}::test_what_sticks_goes_where_the_solid_goes"
PINS = f"{CONTACT}::test_solids_hold_nothing_where_pins_do"
FRICTION = "tests/physics/test_friction.py"
RULE, BALANCED = "taichi_cloth/contact/solid/coulomb.py", "taichi_cloth/contact/solid/balance.py"
RULED = "tests/unit/test_coulomb.py"
HALVED = f"{CONTACT}::test_each_solve_of_a_step_is_twice_as_exact_as_the_one_before"
PROXIMAL = "tests/unit/test_proximal.py"
COULOMBS = f"{CONTACT}::test_friction_in_every_step_is_coulombs"
ROUGH = "tests/physics/test_cloth_on_cloth.py::test_solves_that_others_follow_are_preliminary"
SHAPES = "tests/unit/test_solids.py"
LED_BY_HAND = f"{SHAPES}::test_a_body_that_is_moved_by_hand_is_where_it_then_is"
SWEPT = "tests/unit/test_swept_detection.py"
HARD = "tests/hard/test_hard_contact.py"
LET_OUT = "tests/hard/test_hard_starts.py::test_what_starts_inside_a_ball_comes_out"
EDGES = "tests/hard/test_loaded_edges.py"
DRIVES = "tests/hard/test_drives.py"
PARTS = "tests/physics/test_body_parts.py"
CLOSING = "tests/physics/test_closing_bodies.py"
ARM, MESH_ARM = (f"{CLOSING}::test_an_arm_that_closes_on_a_trunk[{which}]" for which in
                 ("capsules-1", "one_mesh-1"))
BETWEEN, FACING = (f"{CLOSING}::{name}" for name in (
    "test_what_is_between_bears_and_is_resumed_bit_for_bit", "test_surfaces_by_where_they_face"))
PULLED = f"{CLOSING}::test_what_is_pinched_is_pulled_out"
ALONG = f"{CLOSING}::test_a_wall_pushes_cloth_along_a_floor"
LEFT_ACROSS, ACROSS, INSIDE, BORDER, BESIDE = (f"tests/unit/test_pinch.py::{name}" for name in (
    "test_an_edge_that_is_left_across_a_solid_comes_out", "test_raised_edges_are_without_pairs_only_across",
    "test_what_was_pinched_and_is_inside_comes_out", "test_what_is_past_the_border_of_a_surface_is_not_below_it",
    "test_no_small_step_is_refused_beside_what_is_pinched"))
LOWERED = f"{CLOSING}::test_an_arm_that_is_lowered_into_the_trunk_it_grows_from"
HIDDEN, BURIED = "tests/unit/test_buried.py", "taichi_cloth/contact/solid/buried.py"
PLATES, PINCHED = f"{HARD}::test_plates_that_close_on_layers[0.0]", "tests/unit/test_pinch.py"
TESTS = (CONTACT, SHAPES, DRIVES)

SOLVES = "taichi_cloth/step/nonlinear/solid_contact.py"
FACADE = "taichi_cloth/contact/contacts.py"
POINTS = "taichi_cloth/contact/points.py"
STEP = "taichi_cloth/contact/step_start.py"
RESPONSE = "taichi_cloth/contact/solid/solid_contacts.py"
DEPTH = "taichi_cloth/contact/solid/penetration.py"
PAIRS = "taichi_cloth/contact/solid/pairs.py"
FIRM = "taichi_cloth/contact/solid/pairs.py"
HOLDING = "taichi_cloth/contact/solid/active_set.py"
DETECTION = "taichi_cloth/contact/solid/vertices.py"
DISTANCE = "taichi_cloth/contact/solid/sdf.py"
SURFACES = "taichi_cloth/contact/solid/mesh.py"
NEARBY = "taichi_cloth/contact/solid/pair_detector.py"
TREE = "taichi_cloth/contact/solid/tree.py"
SCAN = "taichi_cloth/contact/solid/query.py"
TOUCH = "taichi_cloth/contact/points.py"
CLOSEST = "taichi_cloth/contact/geometry.py"
TRIANGLES = "taichi_cloth/contact/geometry.py"
ROWS = "taichi_cloth/contact/points.py"
ROOM = "taichi_cloth/contact/solid/room.py"
SOLIDS = "taichi_cloth/scene/solids.py"
STACK = "taichi_cloth/contact/stack_order.py"
PINCH, SIDES = "taichi_cloth/contact/solid/pinch.py", "taichi_cloth/contact/solid/facing.py"
LAYERS = "taichi_cloth/contact/cloth/layers.py"
START, GROWTH = "taichi_cloth/contact/settle.py", "taichi_cloth/contact/growth.py"
STARTS = "tests/physics/test_near_starts.py"
APART = f"{STARTS}::test_what_starts_near_is_moved_apart"
GROWS = f"{STARTS}::test_what_was_left_near_grows_to_its_thickness_and_is_resumed_bit_for_bit"

TOLD = "tests/unit/test_starts.py"

MUTATIONS = (
    ("taichi_cloth/simulation/starts.py", "x[vertex[mine]] += (OUTSIDE * found.depth[:, None] * found.normal)[mine]", "pass",
     "cloth that comes out on one side is said to start through", TOLD),
    ("taichi_cloth/simulation/starts.py", "up, down = to - low + solid.thickness", "up, down = to - high + solid.thickness",
     "cloth is told to start where it is inside", TOLD),
    ("taichi_cloth/simulation/parts.py", "next((s for s in self._starts if held[s.particles].any()), None)",
     "next(iter(self._starts), None)", "a start is blamed for all that comes later", TOLD),
    # forces that are told
    (FACADE, "self.solids.let_out(self.detector.inside.particles, self.detector.inside.depth)", "pass",
     "what starts inside blocks steps", LET_OUT),
    (RESPONSE, "out[solid.name] = (-force[mine].sum(axis=0)", "out[solid.name] = (force[mine].sum(axis=0)",
     "loads on solids have the wrong sign", FORCES),
    (RESPONSE, "-np.cross(arm, force[mine]).sum(axis=0))", "np.cross(arm, force[mine]).sum(axis=0))",
     "torques on solids have the wrong sign", FORCES),
    (RESPONSE, "contacts.index, self.forces.held)", "contacts.index, -self.forces.held)",
     "contact forces have the wrong sign", FORCES),
    (RESPONSE, "held[self.sliding.rows] += self", "held[self.sliding.rows] -= self", "sliding friction is told reversed",
     FORCES),
    (RESPONSE, "arm = at[mine] - solid.pose(self.detector.time)[1]", "arm = at[mine] - solid.pose(0.0)[1]",
     "torques are taken about where solids began", FORCES),
    (POINTS, "return (self.rhs - sym_times(", "return (self.rhs + sym_times(",
     "forces of points: the damping's sign", FORCES),
    (RESPONSE, "pairs=self.repulsion.forces(moved, h),",
     "pairs=0 * self.repulsion.forces(moved, h),", "forces of pairs are not told", FORCES),
    (HOLDING, "force[mine] = made_up + (whole - made_up.sum(axis=0)) / len(mine)", "force[mine] = whole",
     "a particle's force counts for each of its contacts", f"{CONTACT}::test_the_corner_of_two_planes_is_loaded_once"),
    # friction
    (RESPONSE, "stick &= mu > 0", "stick &= mu >= 0", "smooth solids stick", f"{CONTACT} {FRICTION}"),
    # preliminary solves
    (STEP, "self.rounds = self.rounds + 1 if self.asked else 0", "self.rounds = self.rounds + 1", "they always are",
     HALVED),
    (STEP, "return self.rounds >= OFTEN", "return True", "also where nothing was to be expected", ROUGH),
    ("taichi_cloth/step/nonlinear/euler.py", "    touches = False", "    touches = True", "free cloth has rough ones too",
     "tests/hard/test_hard_starts.py"),
    ("taichi_cloth/step/nonlinear/newton.py", "max(first, FURTHER) if first >= CG_TOL else first", "max(first, FURTHER)",
     "further solves are rough whatever is asked for", FORCES),
    ("taichi_cloth/step/stepper.py", "(s for s in attempt.solutions if not s.preliminary)", "(s for s in attempt.solutions)",
     "a record tells of preliminary residuals", HALVED),
    # holding
    (HOLDING, "projectors[stick] = np.eye(3)", "projectors[~stick] = np.eye(3)",
     "what slides is held and what sticks is free"),
    (HOLDING, "shifts = normal_shift[:, None] * f.normal",
     "shifts = -normal_shift[:, None] * f.normal", "contacts pull into the solid"),
    (HOLDING, "free = ~np.isin(pinned.index, shared)", "free = np.isin(pinned.index, shared)",
     "pins are lost where cloth touches",
     f"{DRIVES}"),
    (HOLDING, "if size > APART:", "if size > 10 * APART:", "a particle's second contact is ignored",
     f"{HARD}::test_in_the_corner_of_two_planes"),
    (RESPONSE, "down = 2 * np.maximum(nearing, 0) + FALL", "down = 0 * np.maximum(nearing, 0) + FALL",
     "fast cloth is not stopped at the surface", SWEPT),
    (RESPONSE, "PUSH * self.detector.edge * self.start.share", "0 * self.detector.edge * start.share",
     "what is inside is not pushed out", f"{HARD}::test_cloth_that_starts_inside_is_pushed_out_and_counted"),
    (RESPONSE, "active = (known | (f.gap < 0))", "active = (known & (f.gap < 0))", "new contacts are not taken up"),
    (RESPONSE, " & ~self.pinned[f.index]", "", "solids are said to hold what pins hold", PINS),
    (RESPONSE, "np.union1d(mine, by_pins) if len(by_pins) else mine", "mine",
     "pins inside a thickness ask for further solves", PINS),
    # states from step to step, and resumed
    (RESPONSE, "self.accepted, self.penetration.before = self.trial,", "self.accepted, self.penetration.before = States(),",
     "states are lost from step to step",
     f"{FRICTION} {CONTACT}"),
    (RESPONSE, 'STATE = ("accepted", "penetration", "pinches", "thickness_ramp", "adaptive_stiffness")',
     'STATE = ("penetration", "pinches", "thickness_ramp", "adaptive_stiffness")',
     "which way things begin to slide is not resumed",
     RESUME),
    (FACADE, '"warm", "layers", "forcing_terms")', '"warm", "layers")', "nor that first solves were not the last", RESUME),
    # starts
    ("taichi_cloth/contact/solid/tree.py", "ti.max(p[d], p[d + 3], q[d], q[d + 3], r[d], r[d + 3]) < low[d]",
     "ti.max(p[d], q[d], r[d]) < low[d]", "a triangle is looked at where it starts only",
     "tests/unit/test_swept_detection.py::test_edges_and_corners_that_come_near_are_found"),
    (START, "    model.save()\n    detector.paths.begin()", "    detector.paths.begin()",
     "before its start cloth is found to come from one point", f"{STARTS}::test_looking_for_cloths_in_one_place_pairs_nothing_that_lies_apart"),
    (START, "ONE = 1e-3", "ONE = 0.0", "two cloths in one place have no order",
     "tests/physics/test_near_starts.py::test_of_two_cloths_in_one_place_the_later_one_lies_on_the_other"),
    (START, "x[moved] += by[:, None]", "x[moved] -= by[:, None]", "the later of two cloths in one place lies under the other",
     "tests/physics/test_near_starts.py::test_of_two_cloths_in_one_place_the_later_one_lies_on_the_other"),
    (START, "for layered in (False, True):", "for layered in ():", "what starts near stays there", APART),
    (START, "still[fixed] = True", "still[fixed] = False", "pinned vertices are moved apart too", APART),
    (START, "group, still) > 0", "group, still) < 0", "what is moved as one takes what is pinned with it", APART),
    (START, "self.free_of_layers(as_one(by, self.cluster_ids, still), x, still)", "as_one(by, self.cluster_ids, still)",
     "what is moved apart from solids passes through layers", f"{APART}[box-2]"),
    (START, "if not len(near):", "if False:", "cloth that is not near is moved",
     f"{STARTS}::test_what_is_not_near_starts_as_it_was_given"),
    (GROWTH, "np.minimum.at(self.part, rows,", "np.maximum.at(self.part, rows,",
     "what is left near keeps its whole thickness", GROWS),
    (GROWTH, "FURTHER * there, self.part, 1.0)", "FURTHER * there, self.part, self.part)", "thickness does not grow", GROWS),
    (RESPONSE, '"pinches", "thickness_ramp", "adaptive_stiffness")', '"pinches", "adaptive_stiffness")',
     "thickness that grows is not resumed", GROWS),
    ("taichi_cloth/contact/solid/penetration.py", '"spared", "raised", "across"', '"raised", "across"',
     "what is pinched is not resumed", RESUME),
    (FACADE, 'STATE = ("solids", "warm", "layers", "forcing_terms")', 'STATE = ("solids", "layers", "forcing_terms")',
     "where cloth was led is not resumed", RESUME),
    ("taichi_cloth/contact/solid/penetration.py", 'STATE = ("before", ', 'STATE = (',
     "crossings that were there are not resumed", RESUME),
    ("taichi_cloth/step/integrators/safe.py", "self.contacts.force.clear()", "pass", "points of a refused attempt stay",
     "tests/physics/test_solid_contact.py::test_steps_without_contact_know_nothing_of_attempts_in_contact"),
    ("taichi_cloth/step/integrators/safe.py", 'STATE = ("accurate", "robust", "touching", "largest", "mean")',
     'STATE = ("accurate", "robust", "touching", "largest")',
     "the mean acceleration in contact is not resumed", RESUME),
    ("taichi_cloth/step/integrators/safe.py", 'STATE = ("accurate", "robust", "touching", "largest", "mean")',
     'STATE = ("accurate", "robust", "largest", "mean")',
     "that cloth touches is not resumed", RESUME),
    ("taichi_cloth/step/integrators/backward_euler.py", 'STATE: tuple[str, ...] = ("dv",)', "STATE: tuple[str, ...] = ()",
     "the last change of velocity is not resumed", RESUME),
    # detection
    (DETECTION, "R_1, p_1 = pose(poses, self.solid[s], 12)", "R_1, p_1 = pose(poses, self.solid[s], 0)",
     "analytic solids are met where they were", DRIVES),
    (DETECTION, "carried = R_1 @ a + p_1", "carried = R_0 @ a + p_0", "what sticks to analytic solids stays behind", FORCES),
    (DETECTION, "done += here[0] - t", "done += 3 * (here[0] - t)", "strides jump over thin solids", SWEPT),
    (DETECTION, "if n_hit.dot(n_end) < SAME_SIDE and through == 1:", "if n_hit.dot(n_end) < -2 and through == 1:",
     "what flies through a thin solid is put out on its far side", SWEPT),
    (DETECTION, "n_hit.dot(n_end) < SAME_SIDE and through == 1:", "n_hit.dot(n_end) < SAME_SIDE and hit == 1:",
     "a table's top goes on beyond its edge", SWEPT),
    (SURFACES, "(pierced == 1 or leaves == 1)", "(leaves == 1 or leaves == 0)", "a mesh's top goes on beyond its edge", SWEPT),
    (SURFACES, "if gone.norm() > 1e-3 * thick:", "if gone.norm() > 1e3 * thick:", "edges of meshes are hit as faces", SWEPT),
    ("taichi_cloth/contact/solid/pinch.py", "friction=self.rubs)", "friction=0 * self.rubs)", "what is gripped creeps",
     "tests/physics/test_contact_laws.py::test_law[grip-slip]"),
    (STACK, "np.where(row >= 0, self.side[row], out)", "out", "layers that went through in a pinch stay so",
     "tests/unit/test_stack_order.py"),
    (STACK, 'STATE = ("key", "side")', "STATE = ()", "sides of pinched layers forgotten on resume",
     "tests/unit/test_stack_order.py"),
    (STACK, "side * f.gap", "f.gap", "pinched layers are led to their faces' fronts", "tests/unit/test_stack_order.py"),
    (PINCH, "out + np.clip(self.order", "out + 0 * np.clip(self.order", "shares of pinched layers set their order",
     f"{CLOSING}::test_layers_whose_shares_of_the_room_are_the_wrong_way_round_come_out_in_order"),
    ("taichi_cloth/contact/solid/active_set.py", "rcond=APART / 2)", "rcond=None)",
     "near normals share a force as if far apart",
     "tests/physics/test_solid_contact.py::test_a_run_is_resumed_in_contact_bit_for_bit"),
    (DETECTION, "where = slot(out, i, count, gap)", "where = slot(out, i, 0, gap)", "a vertex meets one solid at most", SWEPT),
    (DETECTION, "if out[i, k, 3] > most:", "if out[i, k, 3] < most:", "of many solids the nearest are forgotten",
     "tests/hard/test_hard_contact.py::test_a_vertex_among_many_solids_meets_the_one_that_it_is_deepest_in"),
    (DISTANCE, "depth = ti.abs(q[c]) - (p[c] - p[3])", "depth = ti.abs(q[c]) - p[c]", "rounded boxes are too large", SHAPES),
    (DISTANCE, "n = out * side / length", "n = out / length", "a box's normals point inward on three sides", SHAPES),
    (DISTANCE, "t = ti.min(ti.max((q - a).dot(e) / e.norm_sqr(), 0.0), 1.0)",
     "t = ti.max((q - a).dot(e) / e.norm_sqr(), 0.0)",
     "capsules have no end", SHAPES),
    (DISTANCE, "d = ti.sqrt(a * a + b * b)", "d = ti.max(a, b)", "a cylinder's rim is nearer than it is", SHAPES),
    (SURFACES, "(b - a - self.tree.corner(t, k, 1.0) + self.tree.corner(t, k, 0.0)).norm())", "(b - a).norm())",
     "a triangle's own motion is no closing speed", SWEPT),
    (SURFACES, "side = 1.0 if closed == 1 else side_0", "side = side_0", "cloth stays inside closed meshes",
     f"{HARD}::test_cloth_that_starts_inside_is_pushed_out_and_counted"),
    (NEARBY, "return cloth + 0.5 *", "return 0.5 * cloth + 0.5 *", "edges close in at half their speed", DRIVES),
    (NEARBY, "if d - r < speed:", "if d - r < 0.3 * speed:", "what closes in fast is not looked at", DRIVES),
    (NEARBY, "near = n.dot(out) > INWARD", "near = n.dot(out) > 0.9 + INWARD",
     "edges count only from straight above", SWEPT),
    (SURFACES, "carried = carry(poses, solid, a)", "carried = a", "what sticks to a mesh stays behind", STICKS),
    (NEARBY, "low, high = low - reach, high + reach", "low, high = low + reach, high - reach", "boxes of faces are too small",
     DRIVES),
    (NEARBY, "off > self.skin[0]", "off > 4 * self.skin[0]", "candidates serve paths too far away", SWEPT),
    (NEARBY, "off = 2 * (self.model.x_saved[i] - self.known_start[i]).norm() + ", "off = ",
     "candidates serve paths that begin elsewhere", SWEPT),
    (NEARBY, "self.range[solid] + self.skin[0]", "self.range[solid]", "candidates are those of one path", SWEPT),
    (NEARBY, "everything = self._device or bool(", "everything = bool(", "rows on a device are joined by the host",
     "tests/unit/test_device_layout.py::test_steps_are_the_same[propped]"),
    (NEARBY, "out[k] = 1 - self.has_moved(rows[k, 0])", "out[k] = 0", "candidates of what has not moved are dropped", SWEPT),
    (NEARBY, "everything = self._refits != self.tree.refits", "everything = self._refits == 0",
     "candidates last when solids move", SWEPT),
    (TREE, "if ti.min(p[d], p[d + 3], q[d], q[d + 3], r[d], r[d + 3]) > high[d]:",
     "if ti.min(p[d], q[d], r[d]) > high[d]:", "boxes of triangles where they begin", f"{SWEPT} {DRIVES}"),
    (TREE, "for time in (t, t + h):", "for time in (t, t):", "meshes are met where they were", f"{STICKS} {DRIVES}"),
    (TREE, "key = time, *(R.tobytes() + p.tobytes() for R, p in poses)", "key = (time,)",
     "a body is where it was at that time before it was moved by hand", LED_BY_HAND),
    (TREE, "both[c], both[c + 3])\n                        high[c]", "both[c])\n                        high[c]",
     "boxes of triangles begin where these are", SWEPT),
    (TREE, "bits[row % m] |= 8 << (row // m)", "bits[row % m] |= 4 << (row // m)", "edges are taken for corners", DRIVES),
    (TREE, "return a + s * (b - a)", "return b + s * (b - a)", "vertices of solids are a step ahead", STICKS),
    (TREE, "return 0.24 * edge**2 <= 0.4", "return 0.24 * edge**2 <= 40", "balls that poke through are taken for smooth",
     DRIVES),
    # pairs
    (DEPTH, '("before", "spared", "raised", "across"', '("before", "spared", "across"', "what is raised is not resumed",
     LEFT_ACROSS),
    (DEPTH, "self.across[crossed] = True", "pass", "an edge left across a solid stays there", LEFT_ACROSS),
    (DEPTH, "np.where(self.across, OUT * h, -OUT * h)", "np.where(self.across, OUT * h, 0)", "what was raised stays so",
     LEFT_ACROSS),
    (DEPTH, "self.crossed[~(self.pinched | inside)[self.crossed].any(axis=1)]", "self.crossed", "what is pinched is raised",
     LEFT_ACROSS),
    (DEPTH, "near.pairs.take(rests), replace(near, pairs=near.pairs.take(~rests))", "near.pairs.take(rests), near",
     "pairs hold what crosses where it is", ACROSS),
    (DEPTH, "self._minded(crossed[self.across[crossed].sum(axis=1) < 2])", "self._minded(crossed)",
     "edges without pairs may not cross", ACROSS),
    (DEPTH, "self.detector.thickness_ramp.add(back.vertices, self.detector.part_of(back))", "pass",
     "pairs that come back have all of their thickness", ACROSS),
    (PAIRS, "(now < LEAST), now < LOST", "(now < LEAST), now < -LOST", "how near edges may come is not minded", DRIVES),
    (PAIRS, "was - CREEP)) | (now < LEAST)", "was - CREEP))",
     "what ends below the least distance takes no further round", EDGES),
    (PAIRS, "stop = REPULSION * own / h**2", "stop = 0 * own / h**2", "what comes in is not stopped", DRIVES),
    (PAIRS, "firm = np.where(np.minimum(p.distance, began) < HELD * r, firm, 0.0)", "firm = 0 * firm",
     "pairs get no stiffness by their load", EDGES),
    (PAIRS, "f0 += firm * (limit - p.distance + normal_step)", "f0 += firm * (r - p.distance + normal_step)",
     "pairs are pushed out by the stiffness that holds them", EDGES),
    (FIRM, "needed = np.maximum(load / (GIVE * reach), STIFFER * np.maximum(firm, least))",
     "needed = STIFFER * np.maximum(firm, least)", "stiffness grows by itself, not by load", EDGES),
    (FIRM, "np.minimum(needed, FIRMEST * least)", "needed", "stiffness grows without a bound", EDGES),
    (FIRM, "pulls = (firm > 0) & (load <", "pulls = (firm > 1e9) & (load <", "pairs pull by their stiffness", EDGES),
    (FIRM, "np.minimum(firm, load / (BORNE * reach))", "0.0", "what bears a load that stays forgets it", EDGES),
    (RESPONSE, '"thickness_ramp", "adaptive_stiffness")', '"thickness_ramp")', "stiffness by load is not resumed", EDGES),
    (RESPONSE, "if self.start.pins is not None:  # no", "if False:  # no", "what scripts squeeze gets ever stiffer",
     "tests/unit/test_soft_attach.py::test_what_is_soft_gives_where_a_solid_presses"),
    (FIRM, "self.missed.get(k, 0) >= TIMES", "self.missed.get(k, 0) >= 1", "impacts stiffen pairs at once", EDGES),
    (RESPONSE, "            self.adaptive_stiffness.commit(self.linearized.key",
     "            LoadStiffness().commit(self.linearized.key",
     "stiffness by load is lost from step to step", EDGES),
    (PAIRS, "rhs = (c * f0)[:, None] * p.normal", "rhs = -(c * f0)[:, None] * p.normal", "pairs pull", DRIVES),
    (PAIRS, "drag = c * friction * f /", "drag = -c * friction * f /", "pairs' friction drives on", f"{FORCES} {DRIVES}"),
    (PAIRS, "start = p.of(step.v) + (p.of(step.x_0) - p.carried) / h", "start = p.of(step.v)",
     "pairs' friction forgets the solid's motion",
     f"{CONTACT}::test_what_solids_give_is_what_cloth_gets"),
    (CLOSEST, "t = (B * s + f) / E", "t = (B * s - f) / E", "closest points of edges", SHAPES),
    (CLOSEST, "elif d6 >= 0 and d5 <= d6:", "elif d6 >= 0 and d5 >= d6:", "closest corner of a triangle", SHAPES),
    # the last word
    (NEARBY, "if through(a, b, c, d, e, g) + through(d, e, g, a, b, c) > 0:", "if through(a, b, c, d, e, g) > 1:",
     "crossings are overlooked", f"{SHAPES}::test_crossings_of_a_state_are_seen"),
    (TRIANGLES, "if n.dot(p) * n.dot(q) < 0:", "if n.dot(p) * n.dot(q) > 0:", "edges on one side of a triangle cross it",
     f"{SHAPES}::test_crossings_of_a_state_are_seen"),
    (RESPONSE, "return self.penetration.look_across() and self.may_shrink()", "return False", "crossings reject no step",
     f"{SHAPES}::test_crossings_of_a_state_are_seen"),
    (STEP, "return self.h <= min(self.h_usual, USUAL) / SMALLER", "return self.h <= self.h_usual * SMALLER",
     "every step is the smallest",
     f"{HARD} {DRIVES}"),
    (ROOM, "near = between < thickness", "near = between < 1e9 + thickness", "solids far apart leave no room",
     "tests/unit/test_room.py"),
    (ROOM, "facing = n @ n.T < FACING", "facing = n @ n.T > FACING", "one surface leaves no room",
     "tests/unit/test_room.py"),
    (ROOM, "apart = (s[:, None] != s[None, :]) |", "apart = (s[:, None] == s[None, :]) |",
     "the two sides of one body leave no room",
     "tests/unit/test_room.py"),
    (ROOM, "x[found.index] - height[:, None] * found.normal,", "x[found.index] + height[:, None] * found.normal,",
     "walls stand on the wrong side of cloth", "tests/unit/test_room.py"),
    # what cloth meets, points, solids
    (SCAN, "self._pose(solid, t) + self._pose(solid, t + h)", "self._pose(solid, t) + self._pose(solid, t)",
     "solids stand still in a step",
     f"{STICKS} {FORCES}"),
    (SCAN, "self.time = t + h", "self.time = t", "the solids' time is the step's beginning", FORCES),
    (TOUCH, "push = w[k] * r\n                if ti.static(self.layered):\n                    push += self.turn(e, k).dot(r)",
     "push = -w[k] * r\n                if ti.static(self.layered):\n                    push += self.turn(e, k).dot(r)",
     "points in the product: sign",
     f"{FORCES} {DRIVES}"),
    (ROWS, "return rows - np.einsum", "return rows + np.einsum", "slip has a part along the normal",
     f"{FRICTION} {CONTACT}"),
    (SOLIDS, "(t - self.start) * float(self.fps)", "(t - self.start) / float(self.fps)",
     "sequences run at the wrong speed", SHAPES),
    (SOLIDS, "elif volume < 0:", "elif volume > 0:", "meshes are turned inside out", SHAPES),
    (SOLIDS, "return local @ R.T + p", "return local @ R + p", "surfaces turn the wrong way",
     f"{SHAPES}::test_rotations"),
    (SURFACES, "self.tree.info[triangle][1] == OFF", "self.tree.info[triangle][1] > OFF", "parts that are off are met", PARTS),
    (SCAN, "self.tree.friction[triangle], mu)", "mu, mu)", "all parts have the solid's friction", PARTS),
    (TREE, "np.concatenate(friction)[order]", "np.concatenate(friction)", "parts' friction in the file's order", PARTS),
    # where solids close
    (PINCH, "out, inside = self.detector.faces, new.cosine < FACING,", "out, inside = self.detector.faces, new.cosine < 2,",
     "any corner pinches", ALONG),
    (PINCH, "wanted = (2 * share - 1)", "wanted = (1 - 2 * share)", "layers that are pinched change places", PLATES),
    (PINCH, "np.clip((wanted - (height[0] - height[1])) / size, -most, most)", "(wanted - (height[0] - height[1])) / size",
     "what is pinched goes to its share of the room at once", PINCHED),
    (PINCH, "(both.room < FREE * self._needed(both)) | inside)", "(both.room < FREE * self._needed(both)))",
     "what is pinched is freed inside a solid", PINCHED),
    (PINCH, " & (both.cosine < WEDGE)", "", "cloth stays pinched between one surface and itself", LOWERED),
    (PINCH, "(side.height < -self.thickness[side.solid])", "(side.height > 0)",
     "cloth past the border of a surface is below it", BORDER),
    (DEPTH, "self.sought[particles] = True", "pass", "cloth that is freed inside a solid is not looked for", INSIDE),
    (DEPTH, "self.sought &= self.spared > 0", "pass", "cloth that was inside is looked for there for ever", INSIDE),
    (DEPTH, "rows[~beside[rows].any(axis=1)], faces", "rows, faces",
     "what pinched cloth draws along has to find room", BESIDE),
    (SURFACES, "self.depth[i] == 0 or self.buried.inside[t] == 0", "True", "cloth leaves an arm for the trunk around it",
     HIDDEN),
    (BURIED, "first, sign = j, -1", "first, sign = j, 1", "rays pass by triangles that they go through", HIDDEN),
    (BURIED, "count == 3", "count > 0", "triangles are buried that are so in part", HIDDEN),
    ("taichi_cloth/contact/solid/balance.py", "f.start_gap + self.solids.push", "0 * f.gap",
     "cloth whose nearest surface is another comes out at once", LOWERED),
    (PINCH, "self.led = ~np.isin(index, whole)", "self.led = np.isin(index, index)",
     "scripts' pins give way to what is pinched", PINCHED),
    (PINCH, "projector[np.isin(index, pins.index)] = np.eye(3)", "pass", "what scripts hold in part slips", PINCHED),
    (PINCH, "f.friction * PRESSURE *", "0.5 * f.friction * PRESSURE *", "half of the friction between surfaces", PULLED),
    (PINCH, "a.friction + b.friction", "a.friction", "one side of what is pinched is smooth", PULLED),
    (PINCH, "np.maximum(length(self.slip), CREEP)", "CREEP", "friction of what is pinched grows with its slip", PULLED),
    (PINCH, "self.forces += self.rubs", "pass", "friction of what is pinched is no load", PULLED),
    (PINCH, "taken, wanted = (now / np.maximum(u, CREEP) for u in (length(self.slip), now))",
     "taken, wanted = 0 * now, 0 * now",
     "friction of what is pinched lags", PINCHED),
    (RESPONSE, "ContactRows.join([self.sliding.points, self.pinches.rubbing])", "self.sliding.points",
     "friction of what is pinched is in no ledger", PULLED),
    (SIDES, "self.tree.friction[rows[:, 8].astype(np.int64)]", "self.tree.friction[0 * rows[:, 8].astype(np.int64)]",
     "surfaces beside cloth rub by another's coefficient", FACING),
    (SIDES, "normal.dot(way) > cosine and", "normal.dot(way) > -cosine and", "surfaces that face elsewhere are found", FACING),
    (SIDES, "motion = self.tree.point(t, w, 1.0) - self.tree.point(t, w, 0.0)", "motion = 0 * p",
     "the surface beside cloth stands still", FACING),
    (SIDES, "ti.abs(up) >= sure * d", "True", "surfaces are found past their border", FACING),
    (SIDES, "info[0] != but and", "", "surfaces of a solid that is left out are found", FACING),
    (SIDES, "(only < 0 or info[0] == only)", "True", "surfaces of other solids are found", FACING),
    (PINCH, "np.where(detector.yields[a.solid], -1, a.solid)", "a.solid", "a body does not close on itself", MESH_ARM),
    (PINCH, "whole[self.trial.index] * self.led[:, None]", "whole[self.trial.index]",
     "what pins bear is the solids' too", PINCHED),
    (LAYERS, "self.intersections.resting, self.waived)", "self.intersections.resting)",
     "layers that are pinched meet", PINCHED),
    (LAYERS, "self.freed = not pinched[before].all()", "self.freed = False",
     "layers are not looked at again when freed", PINCHED),
    (DEPTH, "return (self.spared == 0) & ~self.pinched", "return self.spared == 0",
     "how deep pinched cloth is counts", PINCHED),
    (SCAN, "keep, pairs = ~pinched[self.vertices.index],", "keep, pairs = pinched[self.vertices.index] >= 0,",
     "what is pinched has contacts as well", PINCHED),
    (SCAN, "pairs = pairs.take(~around[pairs.own_vertices].any(axis=1))", "pairs = pairs.take(pairs.key >= -1)",
     "edges of solids press on what is pinched", ARM),
    (SCAN, "around[pairs.own_vertices]", "around[pairs.vertices]", "an edge rests by a face's third corner", PINCHED),
    (DEPTH, "self.minded[pairs.own_vertices]", "self.minded[pairs.vertices]", "an edge is minded by a face's third corner",
     PINCHED),
    (RESPONSE, "solids |= np.isin(held.index, self.pinches.trial.index[self.pinches.led])", "pass",
     "what is pinched counts as pinned", ARM),
    (RESPONSE, "either = [self.pinches.forces / 2] * 2", "either = [self.pinches.forces] * 2",
     "each side bears all that the pinched take", BETWEEN),
    (RESPONSE, 'STATE = ("accepted", "penetration", "pinches", ', 'STATE = ("accepted", "penetration", ',
     "what solids close on is not resumed", BETWEEN),
    (RESPONSE, "        self.pinches.commit(self.model.read_particles()[0])\n", "",
     "what was pinched is looked for afresh", ARM),
    (RESPONSE, "self.penetration.spare(np.flatnonzero(self.pinches.around))", "pass", "what was freed may not be inside", ARM),
    (RESPONSE, "        self.pinches.clear()\n", "", "what was pinched stays so when the state is changed", PINCHED),
    (FACADE, "len(self.solids.pinches.accepted.index) > 0 or layered", "layered",
     "pinched cloth alone does not count as contact", PINCHED),
    (FACADE, "bool(self.solids.pinches.where.any()) or layered", "layered", "pinched cloth alone is not met", PINCHED),
    (RULE, "normal - mass * gap / c, 0.0)", "normal, 0.0)", "what comes near bears nothing until it is held", RULED),
    (RULE, "part = np.minimum(1, cone / np.maximum(size, 1e-300))", "part = np.ones(len(size))",
     "friction is not bounded by the cone", RULED),
    (RULE, "& ~back\n", "\n", "what friction has turned round goes on sliding", RULED),
    (BALANCED, "self.k == 1 and self.rubbed", "False and self.rubbed", "a slip front goes a row a solve",
     "tests/physics/test_solved_contact.py::test_a_slip_front_goes_through_in_one_step"),
    (BALANCED, "self.inertia[f.index], start.c)", "self.mass[f.index], start.c)", "a particle resists by its own mass alone",
     "tests/physics/test_contact_laws.py::test_law[rope_holds-slip]"),
    ("taichi_cloth/step/nonlinear/solved_contact.py", "tangential(slips, cones.normal)", "slips",
     "friction presses contacts that open", PROXIMAL + "::test_friction_of_contacts_that_open_in_the_iterations_is_at_right_"
     "angles_to_their_normals"),
    ("taichi_cloth/step/nonlinear/solved_contact.py", " and r.law <= (self.agreed if times == 1 else self.enough)", "",
     "contacts of a solved step may be far off their law",
     "tests/physics/test_solved_contact.py::test_a_rope_that_is_drawn_does_not_chatter"),
    (FACADE, "AGREED = 0.001", "AGREED = 0.3", "contacts may be far off their law", COULOMBS),
    (SOLVES, "tolerance /= 2", "tolerance /= 1", "no solve is more exact than the first", HALVED),
    (SOLVES, "if not self.solutions[-1].preliminary:", "if True:", "a step ends with a preliminary solve", HALVED),
    (FACADE, "if self.found is None or self.found.residual.relative <= NEAR or self.rounds > MET:", "if True:",
     "states of contacts follow from the law alone",
     f"{PROXIMAL}::test_steps_use_it_where_they_are_far_from_the_law_and_only_there"),
    (BALANCED, "bears[single] |= pressed > 0", "pass", "contacts are met one linear solve after the other",
     "tests/physics/test_contact_order.py::test_on_a_slope_and_off_its_edge_the_error_is_a_third"),
    (BALANCED, "self.k >= MET and", "False and", "contacts never keep their planes",
     f"{DRIVES}::test_nothing_driven_into_a_sheet_comes_near_or_through"),
    (BALANCED, "took = normal[:, None] * f.normal", "took = np.maximum(normal, 0)[:, None] * f.normal",
     "contacts that pull agree with the law", "tests/physics/test_friction.py::test_capstan"),
    ("taichi_cloth/step/nonlinear/solved_contact.py", "solids.record_forces(self.reaction, self.began[0])", "pass",
     "forces of contacts are not told", "tests/physics/test_solid_contact.py::test_what_solids_give_is_what_cloth_gets"),
)
