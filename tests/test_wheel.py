"""The wheel: it carries the theory and the bundled world, and works outside the checkout."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The contents of a freshly built wheel, in a folder of their own."""
    folder = tmp_path_factory.mktemp("wheel")
    script = (
        "import os, sys; os.chdir(sys.argv[1]); from hatchling.build import build_wheel; "
        "print(build_wheel(sys.argv[2]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(ROOT), str(folder)],
        capture_output=True,
        text=True,
        check=True,
    )
    with zipfile.ZipFile(folder / done.stdout.split()[-1]) as wheel:
        wheel.extractall(folder / "site")
    return folder / "site"


def run(site, *argv):
    """Run the program from the unpacked wheel alone, in another folder than the checkout."""
    script = (
        f"import sys; sys.path.insert(0, {str(site)!r}); import hssh_kb; "
        f"assert hssh_kb.__file__.startswith({str(site)!r}), hssh_kb.__file__; "
        "from hssh_kb.cli import main; sys.exit(main(sys.argv[1:]))"
    )
    return subprocess.run(
        [sys.executable, "-c", script, *argv], cwd=site.parent, capture_output=True, text=True
    )


def test_the_wheel_holds_no_tests_and_all_data(unpacked):
    names = {p.name for p in unpacked.iterdir() if not p.name.endswith(".dist-info")}
    assert names == {"hssh_kb", "perception"}
    ours = {p.relative_to(ROOT / "axioms") for p in (ROOT / "axioms").rglob("*.lp")}
    packed = unpacked / "hssh_kb" / "axioms"
    assert {p.relative_to(packed) for p in packed.rglob("*.lp")} == ours
    assert (unpacked / "perception" / "worlds" / "office.json").exists()


def test_maps_are_found_with_the_packed_theory(unpacked):
    trace = ROOT / "tests" / "traces" / "grid-3x3-ltplus.json"
    done = run(unpacked, "maps", str(trace), "--all", "--json")
    assert done.returncode == 0, done.stderr
    assert '"consistent": 62' in done.stdout


def test_axioms_are_listed_from_the_wheel(unpacked):
    done = run(unpacked, "axioms")
    assert done.returncode == 0, done.stderr
    assert str(unpacked) in done.stdout
