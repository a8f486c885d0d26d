"""A short simulated drive, its log and its knowledge base, made once; a runner of commands."""

import json
from dataclasses import dataclass

import pytest

from hssh_kb.cli import main


@dataclass
class Answer:
    code: int
    out: str
    err: str

    @property
    def document(self):
        return json.loads(self.out)


@pytest.fixture
def hssh(capsys):
    """Run the command line in this process."""

    def run(*argv):
        capsys.readouterr()
        code = main([str(word) for word in argv])
        out, err = capsys.readouterr()
        assert "Traceback" not in out + err
        return Answer(code, out, err)

    return run


@pytest.fixture(scope="session")
def drive_log(tmp_path_factory):
    """A CARMEN log of a drive through the first places of the bundled world."""
    from perception.carmen_write import write_carmen
    from perception.driver import drive
    from perception.world import load_world

    world = load_world()
    path = tmp_path_factory.mktemp("logs") / "short.log"
    log = drive(world, tour=world.tour[:5], seed=2, controller="route")
    write_carmen(path, log)
    return path


@pytest.fixture(scope="session")
def drive_kb(drive_log):
    """The knowledge base of that log."""
    path = drive_log.with_name("short.hssh")
    assert main(["build", str(drive_log), "-o", str(path)]) == 0
    return path
