"""Bugs in the linear solve: held directions, preconditioners, lattices, conjugate gradients."""

SOLVE, LEVELS = "tests/unit/test_solver.py", "tests/unit/test_multilevel.py"
REFERENCE = "tests/unit/test_reference.py::test_solutions_with_held_directions"
DENSE, EXACT = f"{SOLVE}::test_against_dense", f"{SOLVE}::test_constraints_are_exact_at_any_iteration_count"
SYMMETRIC = f"{LEVELS}::test_it_is_symmetric_and_positive_on_what_is_free"
ITERATIONS, NEST = f"{LEVELS}::test_iterations", f"{LEVELS}::test_hats_add_up_and_nest"
DIAGONAL = f"{LEVELS}::test_levels_have_the_diagonal_of_what_is_free"
AGE = f"{LEVELS}::test_levels_that_last_are_made_anew_when_they_have_aged"
DRIFT = f"{LEVELS}::test_a_lasting_rise_of_iterations_is_told_from_what_comes_and_goes"
SLABS = "tests/unit/test_ordering.py::test_what_lies_on_each_other_is_in_one_block"
PROXIMAL = "tests/unit/test_proximal.py"
TESTS = (SOLVE, LEVELS)

PCG, MULTI, COARSEST = "taichi_cloth/solver/pcg.py", "taichi_cloth/solver/multilevel.py", "taichi_cloth/solver/coarse.py"
HATS = "taichi_cloth/solver/hierarchy.py"
POINT, LATTICE = "taichi_cloth/solver/pointwise.py", "taichi_cloth/solver/lattice.py"
HELD, OPERATOR = "taichi_cloth/system/constraints.py", "taichi_cloth/system/operator.py"

MUTATIONS = (
    (MULTI, "return min(ALIKE[0] * self.operator.model.n, ALIKE[1] * held)", "return ALIKE[0] * self.operator.model.n",
     "levels hold what has come free", f"{LEVELS}::test_levels_do_not_last_where_much_of_what_was_held_comes_free"),
    # the order of vertices
    ("taichi_cloth/backend/ordering.py", "order[np.argsort(slab[order], kind=\"stable\")]", "order",
     "sheets on each other in different blocks", SLABS),
    ("taichi_cloth/system/state.py", "len(scene.cloths) > 1 and any(", "len(scene.cloths) > 9 and any(",
     "vertices go sheet by sheet where sheets meet", SLABS),
    # held directions
    (HELD, "z = (row(target, k) - row(y, k) - self.model.x_saved[i] - self.model.x_offset[i]) / h - self.model.v[i]",
     "z = (row(target, k) - self.model.x_saved[i]) / h - self.model.v[i]", "held particles get speed from y",
     "tests/physics/test_solid_contact.py tests/physics/test_friction.py"),
    (HELD, "z = (row(target, k) - row(y, k) - self.model.x_saved[i] - self.model.x_offset[i]) / h - self.model.v[i]",
     "z = (row(target, k) - row(y, k) - self.model.x_saved[i] - self.model.x_offset[i]) / h",
     "held particles keep their speed besides",
     "tests/unit/test_stepper.py tests/unit/test_ledger.py"),
    (HELD, "out[a] += ti.cast(projector[k, a, b], float) * x[b]",
     "out[a] += ti.cast(projector[k, a, a], float) * x[b] * (a == b)",
     "directions that are not axes are held by their components", f"{DENSE} {REFERENCE}"),
    ("taichi_cloth/system/held.py", "values = np.einsum(\"adi,ai->ad\", basis[index == p], goals).reshape(-1)",
     "values = np.einsum(\"adi,ai->ad\", basis[index == p], 0 * goals).reshape(-1)", "a particle that two pins hold goes to 0",
     f"{SOLVE}::test_what_two_pins_hold_in_one_direction_each_stays_in_both"),
    (HELD, "self.dv[i] = way / c", "self.dv[i] = way", "what is led in a stage goes by the distance, not by a speed",
     "tests/unit/test_integrators.py tests/unit/test_ledger.py"),
    (OPERATOR, "self.rhs_displacement[i] = self.rhs_displacement[i] + shift",
     "self.rhs_displacement[i] = self.rhs_displacement[i] - shift",
     "y goes the other way", f"{DENSE} {REFERENCE}"),
    # block Jacobi
    (POINT, "P = sym_unpack(self.block(i))", "P = ti.Matrix.identity(float, 3)",
     "half-held particles are preconditioned by 1",
     f"{SOLVE}::test_what_two_pins_hold_in_one_direction_each_stays_in_both"),
    (POINT, "self.S[i] = sym(S)", "self.S[i] = sym(C)", "held and free directions change places",
     f"{DENSE} {EXACT}"),
    (POINT, "self.S[i] = ti.Vector.zero(float, 6)", "self.S[i] = ti.Vector([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])",
     "fully held particles are free",
     LEVELS),
    (POINT, "self.is_held[i] = 0\n", "pass\n", "who was held stays held", "tests/unit/test_stepper.py " + DENSE),
    # levels
    (MULTI, "out = self.free(i) * block", "out = block", "hats do not end at held particles", f"{DIAGONAL} {SYMMETRIC}"),
    (MULTI, "out = sym(S @ sym_unpack(block) @ S)", "out = block", "contact's diagonal is not filtered",
     f"{DIAGONAL} {LEVELS}"),
    (MULTI, "                own += self.T[i]\n", "                pass\n", "levels know nothing of contact",
     DIAGONAL),
    (MULTI, "self.own[i] = self.own[i] + self.kink(i)", "pass", "hats of fine meshes end at solids without bending",
     f"{DIAGONAL} {LEVELS}::test_held_patches_of_fine_meshes"),
    (HATS, "total += self.take_weight[k] * values", "total += values", "restriction without weights",
     f"{SYMMETRIC} {ITERATIONS}"),
    (MULTI, "z += self.hats.parent_weight[n][k]", "z += 0 * self.hats.parent_weight[n][k]",
     "coarse levels have no say", f"{ITERATIONS} {SYMMETRIC}"),
    (HATS, "z += self.weight[i][k] * self.z[self.node[i][k]]", "z += self.z[self.node[i][k]]",
     "prolongation without weights", SYMMETRIC),
    (MULTI, "self.counts[n] / size * sym(sym_unpack(D).inverse())", "self.counts[n] * sym(sym_unpack(D).inverse())",
     "nodes are not scaled back",
     DIAGONAL),
    (COARSEST, "self.excess + iterations - (1 + SLACK) * self.cost, 0.0)", "self.excess, iterations - self.cost, 0.0)",
     "what drifts is not summed up", DRIFT),
    (COARSEST, "max(self.excess + iterations - (1 + SLACK) * self.cost, 0.0)",
     "self.excess + max(iterations - self.cost, 0.0)",
     "what comes and goes counts as drift", DRIFT),
    (MULTI, "self.excess <= WORTH", "True", "levels last for ever", AGE),
    (MULTI, "if np.count_nonzero(wanted != self.made_for) > most:", "if False:", "levels last though others are held",
     f"{LEVELS}::test_levels_in_contact"),
    (MULTI, "or wanted[-1] != self.made_for[-1]:", "or False:", "levels last though the step is another", AGE),
    (MULTI, "if anew or self.has_contact:", "if anew:", "levels that last know nothing of what now touches",
     f"{LEVELS}::test_levels_in_contact"),
    (LATTICE, "(np.ptp(column) + 1) + column", "np.ptp(column) + column", "nodes of other places are one", NEST),
    (LATTICE, "owner, where, links = keys[:, 0], keys[:, 1:] / 2, _sharing(node, weight)",
     "owner, where, links = keys[:, 0], keys[:, 1:] / 1, _sharing(node, weight)", "levels do not get coarser", NEST),
    (LATTICE, "node, keys = _split(node, weight, keys, links)", "node, keys = node, keys", "a slit does not part hats",
     f"{LEVELS}::test_a_slit_parts_hats"),
    (LATTICE, "value[value <= 1e-12] = 0.0", "value = 1.0 * (value > 1e-12)",
     "composed hats count instead of adding", NEST),
    (LATTICE, "f[rows[row], q] * total**2", "f[rows[row], q] * total",
     "hinges' hats do not act together",
     f"{LEVELS}::test_levels_have_the_trace_of_hinges_in_flat_cloth"),
    # conjugate gradients
    ("taichi_cloth/backend/phases.py", "if waited > LEAVES:", "if waited > 1 << 30:", "who waits spins for ever",
     "tests/unit/test_phases.py"),
    ("taichi_cloth/backend/phases.py", "A_ROW * rows", "LEAVES", "who waits for a large block leaves as for a small one",
     "tests/unit/test_phases.py"),
    (PCG, "total += self.r[i].norm_sqr()", "total += self.r[i].norm()", "the residual that a solve leaves is another",
     "tests/unit/test_counting.py::test_what_a_solve_leaves_is_summed_up_by_a_kernel"),
    (PCG, "            self.dv[i] = self.translation()", "            self.dv[i] = 0 * self.translation()",
     "free cloth begins at rest",
     "tests/unit/test_integrators.py::test_free_fall_is_exact tests/physics/test_closed_forms.py"),
    (PCG, "self.dv[i] = self.dv[i] + self.translation()", "self.dv[i] = self.dv[i] - self.translation()",
     "momentum that a solve lacks is taken off again", "tests/physics/test_closed_forms.py tests/unit/test_stepper.py"),
    (PCG, "group = min(max(min(self.last - done, LONGEST), LOOK), most - done) if", "group = 1 if",
     "a device is looked at after each iteration",
     "tests/unit/test_counting.py::test_a_solve_on_a_device_waits_for_groups_of_iterations"),
    (PCG, "max(min(self.last - done, LONGEST), LOOK), most", "LOOK, most", "what the last solve took says nothing of the next",
     "tests/unit/test_counting.py::test_a_solve_on_a_device_waits_for_groups_of_iterations"),
    (PCG, "self.count[NEXT] == MULTIPLY, ti.i32)", "self.count[NEXT] >= END, ti.i32)",
     "iterations on a device after the last count",
     "tests/unit/test_counting.py::test_a_solve_on_a_device_waits_for_groups_of_iterations"),
    (PCG, "done + group >= min(self.last, most)", "done + group >= most", "a device waits once more for each residual",
     "tests/unit/test_counting.py::test_a_solve_on_a_device_waits_for_groups_of_iterations"),
    ("taichi_cloth/solver/recurrences.py", "r = self.preconditioner.filter(i, left)", "r = left",
     "the residual is not filtered",
     LEVELS),
    (PCG, "if norm < 0 or first < 0:", "if False:", "a breakdown is no breakdown",
     f"{SOLVE}::test_indefinite_matrix_is_a_breakdown_not_an_answer tests/unit/test_golden.py"),
    (PCG, "if norm <= SLACK * allowed * first:", "if True:", "all that ends has converged", f"{EXACT} {SOLVE}"),
    (MULTI, 'STATE = ("inverse_l", "summed", "age", ', 'STATE = ("age", ', "levels are forgotten on resume",
     f"{LEVELS}::test_a_run_goes_on_with_the_levels_that_it_had"),
    (PCG, "ROUNDING * self.epsilon * math.sqrt(max(size, 0.0)) / first", "1.0", "any residual is rounding",
     f"{SOLVE} {DENSE}"),
    # friction by proximal gradients
    ("taichi_cloth/solver/proximal.py", "if size > self.cone[i]:", "if True:", "contacts that should stick slide backwards",
     PROXIMAL),
    ("taichi_cloth/solver/proximal.py", "if opens < 0:", "if True:", "contacts pull", PROXIMAL),
    ("taichi_cloth/solver/proximal.py", "if slope(0.0) > 0:", "if False:", "a solve that went too far is gone on from",
     PROXIMAL),
    ("taichi_cloth/solver/proximal.py", "(read(field) - part)", "(read(field))", "friction counts twice", PROXIMAL),
    ("taichi_cloth/solver/proximal.py", "if self.count[DID] >= most:", "if self.count[DID] > most:", "one iteration too many",
     PROXIMAL),
)
