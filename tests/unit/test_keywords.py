"""Misspelt keywords of public functions and methods."""

import inspect
import pickle
import subprocess
import sys

import pytest

import taichi_cloth as tc
from taichi_cloth import keywords

MESH, DENIM = tc.grid(1.0, 2), tc.fabrics["denim"]
CALLS = {
    "Scene.add_cloth(colour) color": lambda: tc.Scene().add_cloth(MESH, DENIM, colour="red"),
    "Scene.add_solid(frictoin) friction": lambda: tc.Scene().add_solid(tc.Sphere(1), frictoin=0.3, thickness=0.1),
    "Appearance(colour) color": lambda: tc.Appearance(colour="red"),
    "Fabric(densty) density": lambda: tc.Fabric(densty=0.1, stretch=tc.Stretch(1)),
    "Fabric.scaled(densty) density": lambda: DENIM.scaled(densty=2.0),
    "load(scal) scale": lambda: tc.load("none.obj", scal=2.0),
    "Stretch(K) k": lambda: tc.Stretch(K=10),
    "View(lights) light": lambda: tc.View(lights="sun"),
}


@pytest.mark.parametrize("what", CALLS)
def test_the_nearest_keyword_is_suggested(what):
    named, meant = what.split()
    name, wrong = named.rstrip(")").split("(")
    said = rf"^{name}\(\) got an unexpected keyword argument '{wrong}'. Did you mean '{meant}'\?$"
    with pytest.raises(TypeError, match=said):
        CALLS[what]()


@pytest.mark.parametrize("call, said", [
    (lambda: tc.Scene().add_cloth(MESH, DENIM, layer=1), "It is one of tc.ClothContact$"),
    (lambda: tc.Scene(wind=(1, 0, 0)), "It is one of tc.Air$")])
def test_a_keyword_of_another_is_told_with_who_takes_it(call, said):
    with pytest.raises(TypeError, match=said):
        call()


def test_missing_arguments_are_told_of_what_was_called():
    with pytest.raises(TypeError, match=r"^Scene.add_cloth\(\) missing 1 required positional argument: 'fabric'"):
        tc.Scene().add_cloth(MESH)


@pytest.mark.parametrize("name, meant", [("Sphre", "Sphere"), ("simulatoin", "Simulation"), ("render_frame", "render_frames")])
def test_the_nearest_name_of_the_package_is_suggested(name, meant):
    with pytest.raises(AttributeError, match=rf"'taichi_cloth' has no attribute '{name}'; did you mean '{meant}'\?$"):
        getattr(tc, name)
    assert not hasattr(tc, "nearest")


def test_the_nearest_name_is_suggested_once():
    """Python has a suggestion of its own at the end of a traceback, and notebooks have none."""
    done = subprocess.run([sys.executable, "-c", "import taichi_cloth as tc; tc.Sphre"], capture_output=True, text=True)
    assert done.stderr.lower().count("did you mean") == 1 and done.stderr.endswith("did you mean 'Sphere'?\n")


@pytest.mark.parametrize("name", ["zzzz", "__path_of__", "_Sphre"])
def test_a_name_like_none_and_a_private_one_suggest_nothing(name):
    with pytest.raises(AttributeError, match=f"has no attribute '{name}'$"):
        getattr(tc, name)


CHANGES = {"gravty gravity": (tc.Scene, None), "Air air": (tc.Scene, None), "densty density": (lambda: DENIM, 1.0),
           "colour color": (lambda: tc.Scene().add_cloth(MESH, DENIM), "red"),
           "frictoin friction": (lambda: tc.Scene().add_solid(tc.Sphere(1), 0.3, 0.1), 0.5),
           "K k": (lambda: tc.Stretch(10), 5)}


@pytest.mark.parametrize("what", CHANGES)
def test_attributes_that_there_are_not_are_refused(what):
    """With the nearest that there is, as an error of the project's and as Python's own."""
    (wrong, right), (make, value) = what.split(), CHANGES[what]
    with pytest.raises(tc.SceneError, match=f"has no attribute '{wrong}'; did you mean '{right}'?") as error:
        setattr(make(), wrong, value)
    assert isinstance(error.value, AttributeError)


def test_attributes_that_there_are_change_or_say_how():
    scene, cloth = tc.Scene(), tc.Scene().add_cloth(MESH, DENIM)
    scene.gravity, scene._mine = None, 1
    assert not scene.gravity.any()
    with pytest.raises(tc.SceneError, match=r"fabric of Cloth: .* dataclasses.replace\(..., fabric=...\)"):
        cloth.fabric = DENIM

    class Own(tc.Scene):
        pass

    own = Own()
    own.anything = 3
    assert own.anything == 3, "classes of the user's have attributes of their own"


def test_other_errors_stay_as_they_are():
    def inner(width: float = 1.0, height: float = 1.0) -> None:
        raise TypeError(f"{inner.__qualname__}() got an unexpected keyword argument 'hight'")

    suggests = keywords.suggesting(inner)
    for options in ({"width": 2.0}, {}):  # the caller gave no such keyword: the error is one of what was called
        with pytest.raises(TypeError, match="'hight'$"):
            suggests(**options)
    with pytest.raises(TypeError, match="unexpected keyword argument 'qqqqqqq'$"):
        tc.Scene().add_cloth(MESH, DENIM, qqqqqqq=1)


def test_what_is_passed_on_is_named_by_what_refuses_it():
    """`Recording.render` hands its options to `tc.render`."""
    recording = object.__new__(tc.Recording)
    with pytest.raises(TypeError, match=r"render\(\) got an unexpected keyword argument 'heatt'. Did you mean 'heat'\?"):
        recording.render("a.png", heatt="stretch")


def test_public_names_are_what_they_were():
    assert list(inspect.signature(tc.Scene.add_cloth).parameters)[:3] == ["self", "mesh", "fabric"]
    assert pickle.loads(pickle.dumps(tc.grid)) is tc.grid and isinstance(pickle.loads(pickle.dumps(DENIM)), tc.Fabric)
    assert tc.grid is tc.grid and tc.Scene is tc.Scene


def test_warnings_name_the_line_that_calls():
    """However many functions of the package are in between."""
    with pytest.warns(UserWarning, match="kept out of the simulation") as seen:
        tc.TriMesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]])
    assert [w.filename for w in seen] == [__file__]
    with pytest.warns(UserWarning) as seen:
        tc.Scene().add_cloth(tc.grid(500.0, 2), DENIM)
    assert {w.filename for w in seen} == {__file__}
