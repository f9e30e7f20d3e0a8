"""Numbers that the theory pages state are those of the code."""

import ast
import pathlib

import pytest

ROOT = pathlib.Path(__file__).parents[2]

# page, what it says (the constant's value put in), file, constant
SAID = (
    ("theory/cloth.md", "in the last {:g} rad", "forces/hinge.py", "CREST"),
    ("theory/time.md", "The first\nsolve is to a relative residual of {:g}", "step/nonlinear/newton.py", "FIRST"),
    ("theory/time.md", "the others to {:g}.", "step/nonlinear/newton.py", "OTHERS"),
    ("theory/time.md", "gain more than {:.0%} of the motion's energy", "step/nonlinear/history.py", "GAIN"),
    ("theory/time.md", "\\frac{{{:g}\\ \\text{{s}}}}{{h}}", "step/integrators/tr_bdf2.py", "HORIZON"),
    ("theory/time.md", "every up to {:g} substeps", "step/integrators/verlet.py", "SLOW"),
    ("theory/time.md", "{:g} of that is taken", "step/choice.py", "SAFETY"),
    ("theory/time.md", "no more than {:g} substeps", "step/choice.py", "SUBSTEPS"),
    ("theory/time.md", "(`h`/{:g},", "options.py", "H_MIN_FACTOR"),
    ("theory/solver.md", "`multilevel` from {:g} particles on", "solver/preconditioner.py", "WORTH_LEVELS"),
    ("theory/solver.md", "(up to {:g} times)", "solver/pcg.py", "RESTARTS"),
    ("theory/solver.md", "age has cost {:g} iterations", "solver/multilevel.py", "WORTH"),
    ("theory/solids.md", "k = {:g}\\,\\frac{{m}}{{h^2}}", "contact/solid/pairs.py", "REPULSION"),
    ("theory/solids.md", "in steps {:g} times smaller", "contact/step_start.py", "SMALLER"),
    ("theory/solids.md", "{:g} s.", "contact/solid/penetration.py", "SPARED"),
    ("theory/layers.md", "k = {:g}\\,\\frac{{m}}{{(1/60\\,\\text{{s}})^2}}", "contact/cloth/pair_kernels.py", "REPULSION"),
    ("theory/layers.md", "more than ${:g}\\,r$ a second", "contact/solid/pairs.py", "SETTLING"),
    ("theory/layers.md", "${:g}\\,m/h^2$", "contact/cloth/pair_kernels.py", "STOP"),
    ("theory/layers.md", "(at most {:g} times)", "contact/cloth/contact_pairs.py", "STIFFEST"),
    ("theory/layers.md", "within {:.0%} of all forces", "contact/cloth/layers.py", "AGREED"),
    ("theory/layers.md", "d_f + {:g}\\,(d_0 - d_f)", "contact/cloth/narrow_phase.py", "KEEP"),
    ("theory/layers.md", "stay disabled for {:g} s", "contact/solid/penetration.py", "SPARED"),
)


def constant(file: str, name: str) -> float:
    """A number that a module states at its top."""
    for node in ast.parse((ROOT / "taichi_cloth" / file).read_text()).body:
        if isinstance(node, ast.Assign):
            pairs = [(node.targets[0], node.value)]
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(node.targets[0].elts, node.value.elts))
            for target, value in pairs:
                if isinstance(target, ast.Name) and target.id == name:
                    return ast.literal_eval(value)
    raise AssertionError(f"{file} has no {name}: what docs/ says of it must be looked over")


@pytest.mark.parametrize("page, says, file, name", SAID, ids=[f"{file}-{name}" for _, _, file, name in SAID])
def test_pages_state_the_numbers_of_the_code(page, says, file, name):
    said = says.format(constant(file, name)).replace("%", " %")
    assert " ".join(said.split()) in " ".join((ROOT / "docs" / page).read_text().split()), f"docs/{page}: {said}"
