"""Code that a run imported from outside its applications."""

import importlib
import sys
from pathlib import Path

import pytest

from prefect_robomaker.tasks.runtime.states import imported_code as imported_code_module
from prefect_robomaker.tasks.runtime.states.imported_code import changed_code, digest_of_code, imported_code


@pytest.fixture
def library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder on the import path with a package and a module."""
    package = tmp_path / "lib" / "loose_package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("from . import inner\n")
    (package / "inner.py").write_text("GAIN = 1\n")
    (package.parent / "loose_module.py").write_text("LIMIT = 1\n")
    monkeypatch.syspath_prepend(package.parent)
    for name in ("loose_package", "loose_package.inner", "loose_module"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return package.parent


def test_loose_code_is_known_by_its_files_and_installed_code_by_its_version(library: Path) -> None:
    loaded = {
        name: importlib.import_module(name) for name in ("loose_package", "loose_module", "numpy", "json", "yaml")
    }
    found = imported_code(loaded)
    assert set(found) == {"loose_package", "loose_module", "numpy", "yaml"}
    assert found["numpy"] == f"version {loaded['numpy'].__version__}"
    assert found["yaml"].startswith(("version", "installed"))
    assert changed_code(found) is None
    (library / "loose_package" / "inner.py").write_text("GAIN = 2\n")
    assert changed_code(found) == "loose_package"


def test_what_is_gone_or_another_version_is_another(library: Path) -> None:
    found = imported_code({"loose_module": importlib.import_module("loose_module")})
    (library / "loose_module.py").unlink()
    importlib.invalidate_caches()
    del sys.modules["loose_module"]
    assert changed_code(found) == "loose_module"
    assert changed_code({"numpy": "version 0.1"}) == "numpy"


def test_files_of_applications_are_left_out(library: Path) -> None:
    loaded = {name: importlib.import_module(name) for name in ("loose_package", "loose_module")}
    assert imported_code(loaded, [library]) == {}


def test_this_process_is_the_same_as_itself() -> None:
    assert changed_code(imported_code(sys.modules)) is None


def test_a_process_that_runs_on_sees_what_is_installed_meanwhile(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(imported_code_module, "installed_places", lambda: frozenset({library}))
    (library / "loose_module-1.0.dist-info").mkdir()
    found = imported_code({"loose_module": importlib.import_module("loose_module")})
    assert found == {"loose_module": "version 1.0"}
    assert changed_code(found) is None
    (library / "loose_module-1.0.dist-info").rename(library / "loose_module-1.1.dist-info")
    assert changed_code(found) == "loose_module"


def test_a_module_is_hashed_with_what_was_imported_from_beside_it(library: Path) -> None:
    (library / "loose_neighbour.py").write_text("LIMIT = 1\n")
    loaded = {name: importlib.import_module(name) for name in ("loose_package", "loose_module", "numpy", "json")}
    first = digest_of_code("loose_module", loaded)
    (library / "loose_neighbour.py").write_text("LIMIT = 2\n")
    assert digest_of_code("loose_module", loaded) == first, "it was not imported"
    (library / "loose_package" / "inner.py").write_text("GAIN = 2\n")
    second = digest_of_code("loose_module", loaded)
    (library / "loose_module.py").write_text("LIMIT = 2\n")
    assert len({first, second, digest_of_code("loose_module", loaded)}) == 3


def test_a_package_is_hashed_with_its_networks(library: Path) -> None:
    loaded = {name: importlib.import_module(name) for name in ("loose_package", "loose_module")}
    first = digest_of_code("loose_package", loaded)
    (library / "loose_module.py").write_text("LIMIT = 2\n")
    assert digest_of_code("loose_package", loaded) == first
    (library / "loose_package" / "weights.npz").write_bytes(b"1")
    assert digest_of_code("loose_package", loaded) != first
    assert digest_of_code("absent", loaded) == ""
