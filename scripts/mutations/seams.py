"""One-line bugs in seams, patterns, garments and dressing, and the tests that are to notice them."""

SEAMS, PATTERNS = "tests/physics/test_seams.py", "tests/unit/test_patterns.py"
TESTS = (f"{SEAMS}::test_three_layers_on_one_edge_stay_together",)
CUT = f"{SEAMS}::test_cut_and_sewn_again"
SHARED = f"{SEAMS}::test_what_holds_a_cluster_is_shared_by_masses"
COARSEST = f"{SEAMS}::test_the_coarsest_level_is_q_a_q"
APART = f"{SEAMS}::test_what_is_apart_is_led_together_and_stays_so"
ANGLE = f"{SEAMS}::test_a_seam_comes_to_its_angle"
FEW_ITERATIONS = f"{PATTERNS}::test_seams_cost_few_iterations[0.0225-1871]"
PRESSED = f"{SEAMS}::test_iterations_of_sewn_cloth_in_contact"
FOUND_ANEW = f"{SEAMS}::test_the_coarsest_level_is_found_anew_when_iterations_rise_or_it_is_old"
OTHER_STEPS = f"{SEAMS}::test_the_coarsest_level_follows_the_step"
ITERATIONS, REFUSED = f"{SEAMS}::test_iterations_of_sewn_cloth", f"{SEAMS}::test_what_cannot_be_sewn"

CLUSTERS, COARSE, ELEMENTS = "taichi_cloth/system/seams.py", "taichi_cloth/solver/coarse.py", "taichi_cloth/system/elements.py"
SOLVER = "taichi_cloth/solver/"
HATS, DENSE = SOLVER + "galerkin.py", SOLVER + "dense.py"
CG, POINTWISE, MULTI = SOLVER + "recurrences.py", SOLVER + "pointwise.py", SOLVER + "multilevel.py"
CLOSE, DRAWN = "taichi_cloth/forces/closing.py", "tests/physics/test_pulled_seams.py::test_"
FIRMER, ALONE = DRAWN + "a_firmer_pull_closes_what_stayed_apart", DRAWN + "a_stitch_alone_is_pulled_for_what_it_stands_for"
AROUND = "tests/unit/test_cloth_contact.py::test_what_is_around_some_particles_rests_for_a_tenth_of_a_second"
REACHED, DRAWN_BY = DRAWN + "it_comes_as_near_as_the_pull_reaches", DRAWN + "derivatives"
BEND, PULLS = "taichi_cloth/forces/bend.py", "taichi_cloth/forces/pulls.py"
SPRINGS = "tests/unit/test_soft_attach.py::test_"
SOFT, WORKED = SPRINGS + "derivatives", SPRINGS + "all_of_their_work_is_accounted_for"
CURVES, PATTERN = "taichi_cloth/garment/curves.py", "taichi_cloth/garment/pattern.py"
MESHER = "taichi_cloth/garment/mesher.py"
FILE, GARMENT = "taichi_cloth/garment/garmentcode.py", "taichi_cloth/scene/garment.py"
LOADED = "taichi_cloth/io/garment.py"
QUERIES = "taichi_cloth/simulation/queries.py"
REMESH, REMESHED = "taichi_cloth/garment/remesh.py", "tests/unit/test_remesh.py"
DRESSING, PLACED = "taichi_cloth/garment/dressing.py", "tests/unit/test_placed_panels.py"
STITCHED, SEWN_SHAPE = "taichi_cloth/garment/stitched.py", "taichi_cloth/contact/cloth/sewn_shape.py"
EITHER_END = "tests/unit/test_stitched.py::test_a_stitch_may_name_its_edge_from_either_end"
IN_ORDER = "tests/unit/test_stitched.py::test_places_on_an_edge_are_in_order_from_whichever_end_they_are_named"
FILES = "tests/unit/test_garment_files.py::test_"
OVER_SEAMS = "tests/physics/test_near_starts.py::test_panels_that_lie_apart_are_as_near_as_their_seam_is_long"

RIPPING, STITCHES = "tests/physics/test_ripping.py", "taichi_cloth/system/stitches.py"
RIPS, ORDER, GOES_ON = (f"{RIPPING}::{name}" for name in (
    "test_a_strip_rips_at_its_strength", "test_momentum_is_conserved_and_the_seam_opens_from_its_end",
    "test_a_run_goes_on_bit_for_bit_through_a_rip"))
RESEWN = "tests/physics/test_resewn.py"
BUTTONS = f"{RIPPING}::test_buttons_give_at_their_force"

TEARING, TEAR = "tests/physics/test_tearing.py", "taichi_cloth/step/tearing.py"
SIDES = f"{RIPPING}::test_sides_keep_what_they_have_come_apart_by"
SCORED = f"{TEARING}::test_a_scored_line_tears_at_its_fraction"

MUTATIONS = (
    (STITCHES, "pulled[rows], whole[rows] = drawn, ~drawn", "whole[rows] = True",
     "a seam closes by more than its pull", RESEWN),
    ("taichi_cloth/step/giving.py", "self.contacts.layers.join(self.stitches.whole | self.stitches.pulled)", "pass",
     "contact keeps apart what is to close", RESEWN),
    ("taichi_cloth/contact/cloth/lips.py", "self.together = self.together | whole", "pass", "what has closed is two surfaces",
     RESEWN),
    ("taichi_cloth/simulation/simulation.py", "            script.stitched.clear()\n", "            pass\n",
     "a resumed run closes once more what gave", RESEWN),
    (TEAR, "opened = self._foremost(part, vertex, opens)\n        return self.rows[np.unique([opened, self.other[opened]])]",
     "return self.rows[self._foremost(part, vertex, opens)]", "an edge opens at one end", SCORED),
    (TEAR, "/ self.fraction[mine]", "", "scored lines are as strong as the rest", SCORED),
    ("taichi_cloth/scene/sewing.py", "out[1:] += way / 4", "out[1:] += 0 * way", "stitches stand for half their length", RIPS),
    (STITCHES, "return (part > 1) & (part >= (1 - EVEN) * most)", "return part > 1", "all that is overloaded opens at once",
     ORDER),
    (STITCHES, "np.linalg.norm(tension[a[alone]], axis=1)", "np.abs(tension[a[alone]][:, 0])",
     "only one component of the force counts", BUTTONS),
    (STITCHES, 'STATE = ("whole", "pulled", "firm")', 'STATE = ("firm",)', "a resumed run is whole again", GOES_ON),
    ("taichi_cloth/step/giving.py", "self.tries + 1, True", "self.tries + 1, False",
     "what a tear leaves of its energy in a single solve is let be", "tests/test_scenes.py::test_scene[rip_seam]"),
    ("taichi_cloth/step/giving.py", "self.stitches.model.restore()", "pass", "the step goes on from its end", RIPS),
    ("taichi_cloth/step/nonlinear/layer_contact.py", "            ended = self.accounted(ended)\n", "            pass\n",
     "sides that meet as they recoil end with their first solve", f"{RIPPING}::test_the_energy_of_a_rip_is_accounted_for"),
    ("taichi_cloth/step/nonlinear/euler.py", "self.doubt(ended) < BEARABLE", "True",
     "steps that leave most of their energy unaccounted for pass", f"{RIPPING}::test_the_energy_of_a_rip_is_accounted_for"),
    ("taichi_cloth/contact/cloth/lips.py", "self.together & whole\n        self.resumed()", "self.together & whole",
     "contact is not told of what has opened", SIDES),
    ("taichi_cloth/contact/cloth/lips.py", "np.maximum(self.grown, apart)", "apart",
     "sides keep no more than the distance that they have", SIDES),
    ("taichi_cloth/contact/cloth/lips.py", "label[self.a[opened]]), 0.0, self.grown)",
     "label[self.a[opened]]), self.grown, self.grown)", "what has just opened keeps a thickness at once", SIDES),
    ("taichi_cloth/forces/bend.py", "*= self.host_whole[:, None]", "*= 1", "hinges stay over an open seam",
     f"{RIPPING}::test_hinges_go_with_their_seam"),
    (CLUSTERS, "out = first + rest / (hi - lo)", "out = first", "the first member for the mean", CUT),
    (CLUSTERS, "kept = 1 - CLOSING * h / widest", "kept = 0.0", "seams close at any speed", APART),
    (CLUSTERS, "if again == 0:", "if again == 1:", "velocities against the mean stay", APART),
    (CLUSTERS, "dv[i] -= self.model.v[i] - v", "dv[i] += self.model.v[i] - v",
     "velocities against the mean are doubled", APART),
    (CLUSTERS, "self.model.x[self.members[j]] = x", "pass", "what came together is not put into one place", APART),
    ("taichi_cloth/step/nonlinear/system.py", "self.leads |= sewn is not None", "self.leads |= False",
     "a step that is shortened leaves a seam behind", f"{SEAMS}::test_seams_close_by_as_much_in_steps_that_need_more_solves"),
    (CLUSTERS, "missing = self.member[(row[self._own] >= 0) & ~np.isin(self.member, held.index)]",
     "missing = self.member[:0]", "a pin holds one layer of three"),
    (CLUSTERS, "out[mine] = share[index[mine], None] * total[own]", "out[mine] = rows[mine]",
     "seams count as contact forces", SHARED),
    (CLUSTERS, "out[self.member] = rows - self.share[:, None] * total[self._own]", "out[self.member] = rows",
     "what a pin bears counts as tension of seams"),
    (CLUSTERS, "twice = (corner >= 0)", "twice = (corner >= 10**9)", "faces may be sewn shut", REFUSED),
    (CG, "self.preconditioner.average(i, self.As) + b * self.Ac[i]", "self.As[i] + b * self.Ac[i]",
     "the recurrence forgets seams", CUT),
    (CG, "left = self.preconditioner.average(i, self.operator.b)", "left = self.operator.b[i]", "the residual forgets seams",
     CUT),
    (POINTWISE, "P = self.average(i, self.operator.P)", "P = self.operator.P[i]", "each member's own block", CUT),
    (MULTI, "out += self.hats.interpolated(self.jacobi.sewn.members[j]) / (hi - lo)", "out = self.hats.interpolated(i)",
     "levels pull seams apart", CUT),
    (MULTI, "self.hats.z[n] = self.coarsest.solve(n, self.hats.r)",
     "self.hats.z[n] = sym_times(self.inverse_l[n], self.hats.r[n])", "the coarsest level is not solved", ITERATIONS),
    (MULTI, "D += self.hat(n, i) ** 2 * self.seen(i, self.jacobi.block(i))", "pass",
     "hats that meet only a seam know one side of it", FEW_ITERATIONS),
    (COARSE, "self.drift.excess > self.worth or", "", "the coarsest level ages", FOUND_ANEW),
    (COARSE, " or self.drift.age >= OLD", "", "the coarsest level grows old", FOUND_ANEW),
    (COARSE, "self._held + read(contact)", "self._held.copy()", "the coarsest level knows no contact", PRESSED),
    (COARSE, "H = stiffness * (", "H = 0 * (", "nor what is held", COARSEST),
    (COARSE, "(span / self.span) ** 2", "(self.span / span) ** 2", "nor the step's size", OTHER_STEPS),
    (COARSE, 'STATE = ("matrix", "inverse", "span", "pressed",', 'STATE = ("inverse", "span", "pressed",',
     "a resumed run finds another coarsest level", f"{SEAMS}::test_a_run_that_is_sewn_goes_on_bit_for_bit"),
    (HATS, "mean = np.bincount(index.ravel(), self.weight[~alone], len(code)) / size[code // self.count]",
     "mean = np.bincount(index.ravel(), self.weight[~alone], len(code))", "hats at seams are sums", COARSEST),
    (DENSE, "tiles -= column[:, None] @ row[None]", "tiles -= row[None] @ column[:, None]",
     "tiles are multiplied the wrong way", "tests/unit/test_dense.py"),
    (COARSE, "return (A + A.T) / 2", "return np.diag(np.diag(A))", "the coarsest level's diagonal alone", ITERATIONS),
    (HATS, "RINGS = 2", "RINGS = 0", "columns of the coarsest level are mixed up", COARSEST),
    (ELEMENTS, "vertices = np.stack([i, j, *tips], axis=1)", "vertices = np.stack([j, i, *tips], axis=1)",
     "a seam's angle turned round",
     ANGLE),
    (BEND, "s.cloth.name in names and s.stiffness > 0", "False", "seams without hinges", ANGLE),
    ("taichi_cloth/forces/hinge_rest.py", 'h.angle if seam.rest == "given" else seam.rest',
     'h.angle if seam.rest == "given" else 0.0',
     "seams are all flat", ANGLE),
    (CURVES, "(1 if bool(large) != bool(right) else -1)", "(1 if bool(large) == bool(right) else -1)",
     "arcs on the wrong side",
     PATTERNS),
    (CURVES, "left = np.array([-along[1], along[0]])\n        control",
     "left = np.array([along[1], -along[0]])\n        control",
     "curves bend to the right", PATTERNS),
    (PATTERN, "rows[s.b] if s.together else rows[s.b][::-1]", "rows[s.b]", "seams run the wrong way", PATTERNS),
    (PATTERN, "count[stitch.a] = count[stitch.b] = max(count[stitch.a], count[stitch.b])", "pass",
     "seams of different lengths",
     PATTERNS),
    (PATTERN, "if stitch.a == stitch.b:", "if False:", "an edge is sewn to itself", PATTERNS),
    (PATTERN, "one.end == other.start or other.end == one.start", "False", "a corner is sewn to both its edges' other ends",
     PATTERNS),
    (PATTERN, "else PIECES", "else 1", "curves that cross other edges", PATTERNS),
    (PATTERN, "key=lambda r: abs(", "key=lambda r: -abs(", "the least likely unit is named", PATTERNS),
    (MESHER, "j = np.arange(i + 2, n if i else n - 1)", "j = np.arange(i + 2, n - 1)", "the last edge may cross others",
     PATTERNS),
    (MESHER, "b[j]) <= 0)", "b[j]) < 0)", "a corner on another edge", PATTERNS),
    (FILE, "return z @ y @ x", "return x @ y @ z", "turned about the axes in another order", PATTERNS),
    (FILE, "math.radians(turn))", "0.0)", "a bent panel is not turned",
     f"{PATTERNS}::test_a_bent_panel_is_turned_round_its_axis"),
    (STITCHED, "if min(t, 1 - t) < NEAR_END and not", "if min(t, 1 - t) < 0 and not", "slivers are split off at stitches",
     "tests/unit/test_stitched.py::test_a_place_near_the_end_of_an_edge_is_its_end"),
    (STITCHED, "return any(_key(i, j) in self.of for", "return any(False for",
     "triangles are lost where stitches are near ends of edges",
     "tests/unit/test_stitched.py::test_a_place_near_the_end_of_an_edge_is_its_end"),
    (STITCHED, "if a < b else (v, b, a, 1 - t))", "if a < b else (v, b, a, t))", "a stitch named from the edge's other end",
     EITHER_END),
    (STITCHED, "b if a != b and t > 0.5 else a))", "a))", "a stitch at an edge's far end is sewn to its near one", EITHER_END),
    (STITCHED, "end = a if t < 0.5 else b", "end = a", "so is one that is near the far end", EITHER_END),
    (STITCHED, "(new if forward else new[::-1])", "new", "new vertices of an edge that runs backwards come in the wrong order",
     IN_ORDER),
    (STITCHED, "key=lambda s: min(s[3], 1 - s[3])", "key=lambda s: s[3]", "ends of edges go to whom names them first",
     "tests/unit/test_stitched.py::test_of_two_neighbours_near_the_end_of_edges_the_nearer_is_sewn_to_it"),
    (STITCHED, "t <= AT_END or t >= 1 - AT_END", "t <= AT_END", "an edge is split at its very end",
     "tests/unit/test_stitched.py::test_a_place_at_the_end_of_an_edge_is_that_end_whatever_is_lost_by_it"),
    ("taichi_cloth/scene/sewing.py", "np.isin(self.a, index) | np.isin(self.b, index)", "np.isin(self.a, index)",
     "stitches are named from one side only",
     "tests/unit/test_stitched.py::test_stitches_are_named_by_vertices_of_either_side"),
    ("taichi_cloth/scene/sewing.py", "if mesh.vertex_uv is None:\n        by", "if False:\n        by",
     "seams over a cut of the pattern are as long as in space",
     FILES + "seams_over_a_cut_of_the_pattern_are_as_long_as_their_cloth"),
    (GARMENT, '"uv": mesh.uv,', '"uv": mesh.corner_uv,', "a saved garment has a place for each corner",
     FILES + "what_is_loaded_is_what_was_saved"),
    (LOADED, 'data["uv" if "uv" in data else "corner_uv"]', 'data["uv"]', "older files are no garments",
     FILES + "what_is_done_with_garments_is_done_with_loaded_ones"),
    (SOLVER + "lattice.py", "places if whole.mean() > 0.5 else mesh.x", "mesh.x", "lattices over cut patterns lie in space",
     FILES + "lattices_lie_in_the_pattern"),
    ("taichi_cloth/step/nonlinear/system.py", "        self.solver.dv.fill(0)\n", "        pass\n",
     "a solve begins with what has overflowed", FILES + "what_cannot_be_made_of_levels_is_left_out_with_a_note"),
    (DENSE, "some = values > least", "some = values < np.inf", "what cannot be solved for is",
     "tests/unit/test_dense.py::test_what_is_singular_is_inverted_where_it_is_not"),
    (SEWN_SHAPE, "joins = knots[np.linalg.norm(rest - rest[knots], axis=1) > APART]", "joins = knots[:0]",
     "panels that lie apart push each other off at their seam", OVER_SEAMS),
    ("taichi_cloth/contact/cloth/collision_mesh.py", "ti.min(out, self.sewn_distance[k])", "self.sewn_distance[k] + 1",
     "distances over seams do not count", OVER_SEAMS),
    (STITCHED, "at.append((1 - t) * at[a] + t * at[b])", "at.append((1 - t) * self.x[a] + t * self.x[b])",
     "new vertices of a draped garment are where its pattern is", "tests/unit/test_stitched.py"),
    (STITCHED, "LONGER = 1.25", "LONGER = 0.0", "layers of a seam are divided where others have vertices of their own only",
     "tests/unit/test_stitched.py::test_every_layer_of_a_seam_is_divided_alike"),
    (STITCHED, "while before < len(self.x):", "while before < 0:", "what has been divided divides nothing",
     "tests/cli/test_scripts.py::test_flat_panels_hang_clear_of_the_body_and_of_each_other"),
    (FILE, 'together="right_wrong" in stitch[2:]', "together=False", "right_wrong is not read", PATTERNS),
    (LOADED, "rest, k, bears if np.isfinite(bears) else None)", "rest, k, None)", "a file forgets what seams bear",
     f"{PATTERNS}::test_what_a_seam_is_like_is_in_the_file_and_in_the_scene"),
    (REMESH, "if (self._turns(u, v, w) or", "if (", "corners of panels are cut off", REMESHED),
    (REMESH, "if ways[0] == ways[1] else other.rows[::-1]", "", "seams of panels meshed anew run the wrong way", REMESHED),
    (REMESH, "like._replace(a=one.rows,", "SewnRows(a=one.rows,", "seams meshed anew are all alike", REMESHED),
    (REMESH, "any((has[u] and has[v]) != (has[v] and has[w]) for has in labels)", "False", "labels lose their ends", REMESHED),
    (REMESH, "(np.abs(weight) < INSIDE)", "True", "groups grow by what is beside them", REMESHED),
    (REMESH, "                faces[two] = made\n", "", "triangles that a seam closes to a line", REMESHED),
    (REMESH, "                lost += 1\n", "                pass\n", "stitches that were left out are not told of", REMESHED),
    (REMESH, "or self.size[before] != self.size[after]", "", "seams run on where layers end", REMESHED),
    (REMESH, "d[:, 0] * f[t, 1] - d[:, 1] * f[t, 0]", "d[:, 0] * f[t, 1]", "panels are not where they were", REMESHED),
    (DRESSING, "seam._replace(strength=None)", "seam", "seams rip while they are closed",
     f"{PATTERNS}::test_dressing"),
    (DRESSING, "            if count:\n", "            if False:\n", "panels that a body passes through are dressed",
     f"{PATTERNS}::test_a_body_through_a_panel_between_its_vertices_is_refused"),
    (DRESSING, "for doubt in doubts_of_solid(solid)", "for doubt in ()", "bodies of 140 m are dressed",
     f"{PATTERNS}::test_the_command_dresses"),
    (DRESSING, "for e, f in zip(edges[:, 0]", "for e, f in zip(edges[:1, 0]", "crossings are named in part", PLACED),
    (QUERIES, '"closing" if gap > 0 else', "", "what closes is closed", "tests/physics/test_resewn.py"),
    (LOADED, 'Garment(_mesh(data), _seams(data), data["positions"])', "Garment(_mesh(data), _seams(data))",
     "where a dressed garment is, is lost", PATTERNS),
    (PULLS, "ratio = most / d", "ratio = k", "springs pull with any force", SOFT),
    (PULLS, "if not bounded:", "if False:", "the bound for the derivative", SOFT),
    (PULLS, "total += T * (d - 0.5 * T / k)", "total += 0.5 * T * d", "energy beyond the largest force", SOFT),
    (PULLS, "work += part *", "work += 0 *", "work of springs of first order", WORKED),
    ("taichi_cloth/step/ledger.py", "attachments=work, potential=", "potential=", "work of springs is not recorded", WORKED),
    (CLOSE, "A -= c * c * ratio * sym_outer(u.normalized())", "A += c * c * ratio * sym_outer(u.normalized())",
     "stitches are stiff along their pull", REACHED),
    (CLOSE, "F / ti.static(CLOSING) * self.across(e, self.model.v)", "0.0 * self.across(e, self.model.v)",
     "forces that are asked for know no dashpot", DRAWN_BY),
    (CLOSE, "damped += 0.5 *", "damped += 1.0 *", "twice the damping", REACHED),
    ("taichi_cloth/system/stitches.py", "self.pulled &= ~near", "pass", "what is closed is pulled on", REACHED),
    (GARMENT, "x[rows] += checks", "x += checks", "all panels are moved", PLACED),
    (GARMENT, "u / r, (middle - low) @ v +", "u / r, 0 *", "a bent panel leaves its place along the axis", PLACED),
    (GARMENT, "across if across @ side > 0 else -across", "across", "a panel is bent to the wrong side", PLACED),
    (GARMENT, "if not size[2] <= FLAT * size[1]:", "if False:", "what is not flat is bent", PLACED),
    (DRESSING, "return 0 < min(crossed[-PATIENCE:]) <", "return min(crossed[-PATIENCE:]) <",
     "a garment of which nothing crosses settles on",
     "tests/unit/test_patterns.py::test_a_garment_settles_as_long_as_crossings_become_fewer"),
    (DRESSING, "if firm < FIRMEST:", "if False:", "what no longer closes gets no stronger pull", PLACED),
    (DRESSING, "contact if meets else None, tell)", "None, tell)", "cloth does not meet itself while it is sewn", PLACED),
    (DRESSING, "if contact is not None and firm >= FIRM:", "if False:", "what does not close meets all beside it", PLACED),
    (DRESSING, "sim.contacts.layers.release_around(np.array(nearest.particles))", "pass",
     "layers that no step parts do not rest", PLACED),
    (DRESSING, "                finest = 0.0\n", "                raise\n", "what solids stop ends the sewing", PLACED),
    ("taichi_cloth/contact/cloth/layers.py", "near[particles] = True", "near[:] = True", "all of the cloth rests", AROUND),
    ("taichi_cloth/contact/cloth/layers.py", "self.intersections.release(np.flatnonzero(near))\n        self._let_rest()",
     "self.intersections.release(np.flatnonzero(near))", "what is to rest does not", AROUND),
    ("taichi_cloth/scene/sewing.py", "for v in (a[0], b[0]):", "for v in (a[0], a[0]):", "a stitch has one end", ALONE),
    ("taichi_cloth/scene/sewing.py", "way.sum() / 4 if v in borders else way.mean() / 2", "way.sum() / 4",
     "stitches within the cloth are led", ALONE),
    ("taichi_cloth/system/stitches.py", 'STATE = ("whole", "pulled", "firm")', 'STATE = ("whole", "pulled")',
     "a run resumed forgets how firmly it pulls", FIRMER),
    ("taichi_cloth/system/stitches.py", "self.firm * self.pulled", "self.pulled", "firmer pulls are not", FIRMER),
    ("taichi_cloth/step/stepper.py", "self.giving.pull_firmer(factor)\n            self.start = None",
     "self.giving.pull_firmer(factor)", "a step gains what firmer pulls store", FIRMER),
)
