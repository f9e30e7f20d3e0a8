"""Bugs in what runs kernels: which are shared, which fields come again, where threads run and what they take."""

SECOND = "tests/unit/test_second_simulation.py"
SHARED = f"{SECOND}::test_kernels_are_shared_where_they_read_the_same_and_only_there"
OPEN = f"{SECOND}::test_simulations_that_are_open_at_a_time_compile_once_and_go_as_alone"
MEMORY = "tests/unit/test_memory.py"
PLACED, DEALT, LAUNCHED = (f"tests/unit/test_{name}.py" for name in ("placement", "dealing", "launches"))
TESTS = (SECOND, MEMORY, PLACED, DEALT, LAUNCHED)

KERNELS, POOL, PLACEMENT, DEALING, ROWS, LAUNCHES, RUNTIME = (f"taichi_cloth/backend/{name}.py" for name in (
    "shared_kernels", "field_pool", "placement", "dealing", "rows", "launches", "runtime"))
COMPILER = "taichi_cloth/backend/compiler.py"
ENVIRONMENT, COMPILERS = "tests/unit/test_environment.py", "tests/unit/test_compiler.py"
FILLED = f"{SECOND}::test_memory_is_filled_as_kernels_fill_it"

SUMS, REPORT = "taichi_cloth/backend/sums.py", "taichi_cloth/system/assembler.py"
LISTS, ARRAYS = "taichi_cloth/backend/device_lists.py", "taichi_cloth/backend/device_arrays.py"
ROWS_THERE, PAIRS_THERE = (f"taichi_cloth/contact/cloth/{name}.py" for name in ("candidate_rows", "resident_pairs"))
POINTS, HELD, EXACT = (f"taichi_cloth/{name}.py" for name in ("contact/points", "system/constraints", "solver/device_coarse"))
LISTED = "tests/unit/test_device_lists.py"
COUNTED, LAYOUTS = "tests/unit/test_counting.py::test_", "tests/unit/test_device_layout.py::test_"
INVERTED = LAYOUTS + "the_level_that_is_solved_exactly_is_inverted_on_a_device"

MUTATIONS = (
    ("taichi_cloth/backend/quota.py", "for folder in (inside, *inside.parents):", "for folder in (inside,):",
     "what groups above are given does not count", "tests/unit/test_quota.py"),
    (KERNELS, "return type(value), value", "return type(value), 0", "numbers are not compared", SHARED),
    (KERNELS, 'weakref.ref(value.share.slot if hasattr(value, "share") else value)', "type(value)",
     "fields are not compared", SHARED),
    (KERNELS, "self.same[path] = self._paths[id(value)]", "pass", "two names of an object are not", SHARED),
    (KERNELS, "if not known and not _of_taichi(function) and any(", "if False and any(",
     "what plain Python reads does not count", SHARED),
    (KERNELS, "if token is None:\n            self.whole = False", "if token is None:\n            self.whole = True",
     "what cannot be compared does not count", SHARED),
    (POOL, "share.slot.numbers[...] = 0", "pass", "fields come again with what they held",
     f"{SECOND}::test_fields_come_again_and_are_zero"),
    (POOL, "            holder.swapped_out, lease.swapped_out = numbers[: holder.field.rows].copy(), True\n",
     "            pass\n", "numbers of an open simulation are lost", OPEN),
    (LAUNCHES, "        swap_in(shares)\n        context", "        context",
     "a known launch takes the numbers that are there", OPEN),
    (KERNELS, "        reads.beside += _shares(_enclosed(self.func))\n", "", "fields of a closure are not swapped in",
     f"{SECOND}::test_kernels_of_users_see_the_numbers_of_their_own_simulation"),
    (POOL, "oldest = min(", "oldest = max(", "the newest goes first", f"{SECOND}::test_the_pool_is_bounded"),
    (POOL, "self.tree.address + _scalar(self.field).snode.ptr.parent.offset_bytes_in_parent_cell", "self.tree.address",
     "the first field is set to zero instead",
     f"{SECOND}::test_fields_come_again_and_are_zero"),
    (POOL, "np.dtype(to_numpy_type(self.field.dtype))", "np.dtype(np.float32)", "integers are put into memory as reals",
     FILLED),
    (ROWS, "numbers(field)[: field.rows].copy()", "field.share.memory[: field.rows]", "what is read is no copy", FILLED),
    (ROWS, "numbers(field).take(which, axis=0)", "field.share.memory[: len(which)]",
     "the first rows are read, not those named", FILLED),
    (ROWS, "hand_over(field, width, which[j], out, j)", "hand_over(field, width, j, out, j)",
     "a device hands over the first rows, not those named", COUNTED + "rows_are_handed_over_by_kernels_as_they_lie_in_memory"),
    (SUMS, "self.pieces * (group + 1) // self.groups", "self.pieces * group // self.groups + 1",
     "of a group the first piece alone is summed up", COUNTED + "sums_of_groups_are_those_of_all"),
    ("taichi_cloth/backend/bvh.py", "for size in ti.static(self.sizes):", "for size in ti.static(self.sizes[1:]):",
     "lowest boxes of a tree are left out on a device",
     "tests/unit/test_contact_reference.py::test_all_pairs_in_reach_are_found_as_they_are"),
    ("taichi_cloth/forces/gas.py", "self.change.finish(self.size[1])", "pass",
     "sums over all of a gas are not made on a device", LAYOUTS + "steps_are_the_same"),
    (REPORT, "most = ti.max(most, rows[row, column])", "most = rows[row, column]",
     "the largest number of a report is the last", LAYOUTS + "a_report_of_many_blocks"),
    (REPORT, "if column == ti.static(self._peaks[k]):", "if column == k:", "largest numbers are those of the first columns",
     LAYOUTS + "a_report_of_many_blocks"),
    ("taichi_cloth/backend/answers.py", "self._take(self.numbers, first)", "self._take(self.numbers, 0)",
     "the first numbers come again and again", LAYOUTS + "a_report_of_many_blocks"),
    (LISTS, "first[piece] = before", "first[piece] = before - of_group[0]", "lists of a device begin at another place",
     LISTED),
    (LISTS, "self._expect(int(rows.GROWTH * self.total))", "self.total = self._expected",
     "rows beyond those expected are lost", LISTED),
    (ARRAYS, "not np.array_equal(values, self._last)", "False", "a device keeps poses as they were first", LISTED),
    (ARRAYS, "weakref.finalize(host, self._of.pop, id(host), None).atexit = False", "pass",
     "copies of what is gone are taken for those of other things", LISTED),
    (ROWS_THERE, "self._append(kept, ", "self._append(0, ", "candidates that are found replace those that stay", LISTED),
    (ROWS_THERE, "below[k] = ti.cast(part[k] < 1, ti.i8)", "below[k] = ti.cast(part[k] <= 1, ti.i8)",
     "all pairs block a step", LISTED),
    (POINTS, "self.A[e][c] = numbers[k, CORNERS + c]", "self.A[e][c] = numbers[e, CORNERS + c]",
     "blocks of a device have points of others", LAYOUTS + "steps_are_the_same"),
    (PAIRS_THERE, "end[k], factor[k], radius[k] =", "end[k], radius[k], factor[k] =",
     "a device takes distances of pairs for their parts", LAYOUTS + "steps_are_the_same"),
    (EXACT, "w = node[f], share[e] * weight[f]", "w = node[f], weight[f]", "a hat counts once on a device",
     INVERTED),
    (EXACT, "if self._finish(self.C, self.positive) < self.count:", "if self._finish(self.C, self.positive) < 0:",
     "what is not positive definite is inverted all the same on a device", INVERTED),
    (HELD, "to_target[k, a], to_y[k, a] = target[k, a], y[k, a]", "to_target[k, a], to_y[k, a] = target[k, a], 0.0",
     "particles are not brought to solids on a device", LISTED),
    (HELD, "(row(target, k) - self.model.x[i]) / c - self.dv[i]", "(row(target, k) - self.model.x[i]) - self.dv[i]",
     "what is still to go on a device takes a second", LAYOUTS + "steps_are_the_same"),
    (ROWS, "field[j // width][j % width] = number", "field[j // width][0] = number",
     "a device gets first numbers alone", FILLED),
    (LAUNCHES, "out += arg.dtype, arg.ndim", "out += (arg.ndim,)", "arrays of another type are taken for it", LAUNCHED),
    (LAUNCHES, "if self._compiled is not kernel.compiled_kernels:", "if False:", "kernels of the Taichi before are launched",
     LAUNCHED),
    (LAUNCHES, "        self._known.clear()", "        pass", "kernels go on with fields that have been replaced", LAUNCHED),
    (LAUNCHES, "if not arg.flags.c_contiguous or", "if", "strides are passed over", LAUNCHED),
    (LAUNCHES, "out += Ndarray, id(arg.dtype), len(arg.shape)", "out += Ndarray, len(arg.shape)",
     "a device's arrays of another type are taken for it", LAUNCHED),
    (LAUNCHES, "isinstance(arg, REALS if kind == \"real\" else INTEGERS)", "isinstance(arg, REALS)",
     "reals are cut to integers", LAUNCHED),
    (POOL, "if self._start == _starts[0]:", "if False:", "fields that no other may have stay", MEMORY),
    (POOL, "if self._start == _starts[0]:", "if True:", "dead fields are given back", MEMORY),
    (DEALING, "self.taken[0] = 0", "pass", "a second loop has no pieces left", DEALT),
    (PLACEMENT, "Placement(new[-count:], cores)", "Placement(new[:count], cores)", "threads that compile are bound instead",
     f"{PLACED}::test_threads_that_work_are_bound_where_there_are_as_many_as_cores"),
    (PLACEMENT, "if len(cores) == count <= len(new):", "if count <= len(new):", "fewer threads than cores are bound",
     f"{PLACED}::test_only_as_many_as_there_are_cores_are_bound"),
    (PLACEMENT, "if lost > WAITED * (did + lost):", "if False:", "threads stay where others keep the core busy", PLACED),
    (PLACEMENT, "if did + lost < ENOUGH:", "if False:", "threads are let go for a short wait", PLACED),
    (PLACEMENT, "min(2 * self._rest, LONGEST)", "REST", "what is no use is tried as often", PLACED),
    (PLACEMENT, "            self._rest = REST\n", "            pass\n", "a neighbour that has gone counts", PLACED),
    (PLACEMENT, "        self._next = now + LOOK\n", "", "threads are looked at in every step", PLACED),
    (PLACEMENT, "if not set(self.threads) <= running():", "if False:", "threads of other programs are bound", PLACED),
    (PLACEMENT, "if jump > JUMP else numbers", "if False else numbers", "numbers that begin anew are not seen", PLACED),
    (POOL, "        self._taken = []\n", "", "what was freed is freed again by the garbage collector", SECOND),
    (RUNTIME, "redirect_stdout(words), _unasked():", "redirect_stdout(words):", "TI_ARCH comes before the arch asked for",
     ENVIRONMENT),
    ("taichi_cloth/backend/kernel_cache.py", "if _writable(", "if True or _writable(",
     "Taichi fails where it cannot write its cache", ENVIRONMENT),
    ("taichi_cloth/__init__.py", '"HOME" not in os.environ', "False", "Taichi ends the process without a home", ENVIRONMENT),
    (RUNTIME, "TemporaryDirectory() as folder, _unasked():", "TemporaryDirectory() as folder:", "TI_ARCH is tried instead",
     ENVIRONMENT),
    ("taichi_cloth/backend/kernel_cache.py", "folder if name == compiler.DEFAULT else os.path.join(folder, name)", "folder",
     "compilers share a folder of kernels", COMPILERS),
    (COMPILER, 'return {} if chosen().name == DEFAULT else {"compiler": chosen().name}', "return {}",
     "a sweep has rows of another compiler", COMPILERS),
    (COMPILER, '("compile_tier", "full"), ', "", "steps of taichi_forge take seven times as long", COMPILERS),
    (COMPILER, "if not found.installed:", "if False:", "an absent compiler is no error of ours", COMPILERS),
    (POOL, "SEEN = None not in (get_addr, to_numpy_type)", "SEEN = True", "a private part of a compiler is needed", COMPILERS),
)
