"""One-line bugs in what is shown in the browser as it runs, and the tests that are to notice them."""

LIVE, TESTS = "taichi_cloth/live/", ("tests/unit/test_live.py", "tests/unit/test_live_parts.py")
RUNS, PARTS, SOFT = TESTS[0] + "::test_", TESTS[1] + "::test_", "tests/unit/test_soft_attach.py"
MUTATIONS = (
    (LIVE + "session.py", "self._clock += late", "pass", "lost time is made up for",
     RUNS + "it_keeps_to_the_clock_and_does_not_rush_after_what_it_lost"),
    (LIVE + "session.py", "moved = not anew and", "moved =", "a reset goes on", RUNS + "play_pause_step_and_reset"),
    (LIVE + "session.py", "and self._live.tally.steps > 0", "", "kernels are loaded before a change is seen",
     RUNS + "before_the_first_step_another_fabric_is_shown_at_once"),
    (LIVE + "session.py", "self._live.checkpoint() if goes_on else None", "None", "every change begins again",
     RUNS + "another_stiffness_goes_on_with_the_cloth_as_it_is"),
    (LIVE + "session.py", "            hand.let_go()\n", "            pass\n", "a hand does not let go",
     RUNS + "a_hand_pulls_with_so_many_weights_at_most_and_lets_go"),
    (LIVE + "session.py", "            before.close()\n", "            pass\n", "simulations before stay open", TESTS[0]),
    (LIVE + "hand.py", "/ len(self.patch)\n", "\n", "each vertex is pulled by all",
     RUNS + "a_hand_pulls_with_so_many_weights_at_most_and_lets_go"),
    (LIVE + "hand.py", "scene.forces.remove(Pulls)", "pass", "a scene keeps the hand's force",
     PARTS + "a_scene_is_pullable_for_a_simulation_and_then_as_it_was"),
    (LIVE + "orders.py", "            if key:\n", "            if False:\n", "every place of a slider is an order",
     PARTS + "of_orders_with_one_key_the_last_is_made"),
    (LIVE + "controls.py", "if event.client is not None:", "if True:", "the program's own changes are orders",
     PARTS + "every_control_asks_for_what_it_says"),
    (LIVE + "teller.py", "if self._busy and", "if False and", "a page is told faster than it shows",
     RUNS + "a_page_is_told_no_faster_than_it_shows"),
    (LIVE + "teller.py", "        if late:\n", "        if False:\n", "what a page was too slow for stays away",
     RUNS + "a_page_is_told_no_faster_than_it_shows"),
    (LIVE + "page.py", "configure_environment_map(None)", "configure_environment_map()", "a browser without a GPU waits",
     PARTS + "the_page_is_lit_by_lamps_alone"),
    ("taichi_cloth/scene/scene.py", "relative), None, 0.0, *soft)", "relative))", "motions are never soft", SOFT),
)
