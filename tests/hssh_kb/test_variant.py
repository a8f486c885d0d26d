"""The fingerprint of the theory: it stands for rules that the Python twins were tested equal to."""

import shutil

from hssh_kb.theory import packaged_directory, use_axioms
from hssh_kb.variant import FINGERPRINTS, Variant, fingerprint_rules, list_changes


def test_the_packaged_rules_are_those_the_twins_repeat():
    # Whoever changes a rule changes the Python twins too, sees the tests that hold both equal to
    # brute force pass, and only then writes the new fingerprint into hssh_kb/variant.py.
    found = {n: fingerprint_rules(packaged_directory() / f"{n}.lp") for n in FINGERPRINTS}
    assert found == FINGERPRINTS
    assert list_changes() == ()
    assert Variant().is_plain
    assert Variant().tell() == ""


def test_every_file_that_is_mirrored_counts(tmp_path):
    for name in FINGERPRINTS:
        own = shutil.copytree(packaged_directory(), tmp_path / name.replace("/", "_"))
        path = own / f"{name}.lp"
        path.write_text(path.read_text() + "\nviolation(mine, x) :- visit(0).\n")
        try:
            use_axioms(own)
            assert list_changes() == (f"{name}.lp",)
        finally:
            use_axioms(None)
