"""Bugs in what runs kernels: which are shared, and which fields come again."""

SECOND = "tests/unit/test_second_simulation.py"
SHARED = f"{SECOND}::test_kernels_are_shared_where_they_read_the_same_and_only_there"
MEMORY = "tests/unit/test_memory.py"
TESTS = (SECOND, MEMORY)

KERNELS, POOL = (f"taichi_cloth/backend/{name}.py" for name in ("shared_kernels", "field_pool"))

MUTATIONS = (
    (KERNELS, "return type(value), value", "return type(value), 0", "numbers are not compared", SHARED),
    (KERNELS, "return Field, weakref.ref(value)", "return Field, type(value)", "fields are not compared", SHARED),
    (KERNELS, "self.same[path] = self._paths[id(value)]", "pass", "two names of an object are not", SHARED),
    (KERNELS, "if not known and not _of_taichi(function) and any(", "if False and any(",
     "what plain Python reads does not count", SHARED),
    (KERNELS, "if token is None:\n            self.whole = False", "if token is None:\n            self.whole = True",
     "what cannot be compared does not count", SHARED),
    (POOL, "slot.clear(tree.address)", "pass", "fields come again with what they held",
     f"{SECOND}::test_fields_come_again_and_are_zero"),
    (POOL, "known[1].used = True", "pass", "two simulations share fields", SECOND),
    (POOL, "oldest = min(", "oldest = max(", "the newest goes first", f"{SECOND}::test_the_pool_is_bounded"),
    (POOL, "address + self.node.offset_bytes_in_parent_cell", "address", "the first field is set to zero instead",
     f"{SECOND}::test_fields_come_again_and_are_zero"),
    (POOL, "dtype=to_numpy_type(self.field.dtype)", "dtype=np.float64", "integers are put into memory as reals",
     f"{SECOND}::test_memory_is_filled_as_kernels_fill_it"),
    (POOL, "if self._start == _starts[0]:", "if False:", "fields that no other may have stay", MEMORY),
    (POOL, "if self._start == _starts[0]:", "if True:", "dead fields are given back", MEMORY),
    (POOL, "        self._taken = []\n", "", "what was freed is freed again by the garbage collector", SECOND),
)
