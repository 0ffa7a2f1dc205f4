"""Own code: the module that was named, from its folder, and nothing else of that folder."""

import sys

import pytest

from edge_runtime.common.own_code import import_own


@pytest.fixture(autouse=True)
def _nothing_stays():
    before, path = set(sys.modules), list(sys.path)
    yield
    assert sys.path == path
    for name in set(sys.modules) - before:
        del sys.modules[name]


@pytest.fixture
def write(tmp_path):
    def write_file(name, text):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return tmp_path

    return write_file


def test_a_module_of_a_folder(write):
    folder = write("my_north.py", "import sys\nPATH = list(sys.path)")
    module = import_own("my_north", folder)
    assert sys.path == module.PATH
    assert import_own("my_north", folder) is module is sys.modules["my_north"]


def test_nothing_that_lies_beside_it_takes_anothers_place(write):
    write("colorsys.py", "raise SystemExit('was run')")
    write("numpy.py", "raise SystemExit('was run')")
    folder = write("my_north.py", "import colorsys, numpy")
    sys.modules.pop("colorsys", None)
    assert str(folder) not in import_own("my_north", folder).colorsys.__file__
    assert import_own("numpy", folder) is sys.modules["numpy"]  # what is installed is found first


def test_a_package_has_its_own_modules(write):
    write("my_own/__init__.py", "")
    write("my_own/geometry.py", "NORTH = 1.5")
    folder = write("my_own/north.py", "from my_own import geometry\nfrom .geometry import NORTH")
    module = import_own("my_own.north", folder)
    assert (module.NORTH, module.__name__) == (1.5, "my_own.north")


def test_the_same_name_in_another_folder_is_another_module(write, tmp_path):
    write("a/my_own/__init__.py", "")
    write("a/my_own/north.py", "PLACE = 'a'")
    write("b/my_own/__init__.py", "")
    write("b/my_own/north.py", "PLACE = 'b'")
    assert [import_own("my_own.north", tmp_path / place).PLACE for place in "aba"] == ["a", "b", "a"]


def test_a_module_that_fails_is_not_half_there(write):
    folder = write("my_north.py", "1 / 0")
    with pytest.raises(ZeroDivisionError):
        import_own("my_north", folder)
    write("my_north.py", "FINE = True")
    assert import_own("my_north", folder).FINE


@pytest.mark.parametrize("name", ["my_nothing", "my_nothing.north", "my_folder"])
def test_a_module_that_is_nowhere(write, name):
    folder = write("my_folder/notes.txt", "")
    with pytest.raises(ModuleNotFoundError, match="No module named 'my_"):
        import_own(name, folder)
