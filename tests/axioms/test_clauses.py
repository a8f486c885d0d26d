"""No clause of the theory is idle: without any one of them, some witness is answered wrongly."""

import pytest
from clauses import list_files, list_mutants, make_reader, read_closure_names
from witnesses import WITNESSES

FILES = list_files()
CLOSURES = [(read_closure_names(witness.files), witness) for witness in WITNESSES]


def find_witnesses(file):
    """The witnesses that read a file: those named after its axiom, then those of fewest files."""
    name = file.partition("_")[2]
    reading = [(files, witness) for files, witness in CLOSURES if file in files]
    reading.sort(key=lambda pair: (name not in pair[1].name, len(pair[0])))
    return [witness for _, witness in reading]


def is_noticed(mutant):
    read = make_reader(mutant)
    return any(witness.fails(read) for witness in find_witnesses(mutant.file))


@pytest.mark.parametrize("witness", WITNESSES, ids=lambda witness: witness.name)
def test_witness_is_answered_rightly(witness):
    assert witness.ask(make_reader()) == witness.expected


@pytest.mark.parametrize("file", FILES)
def test_no_clause_is_idle(file):
    mutants = list(list_mutants(file))
    assert mutants
    assert [str(mutant) for mutant in mutants if not is_noticed(mutant)] == []
