"""The README says what is true: its commands give the output that stands below them."""

import re
import shlex
from pathlib import Path

import pytest

from hssh_kb.trace import parse_trace

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
BLOCK = re.compile(r"```console\n\$ (?P<command>.+)\n(?P<output>(?:.*\n)*?)```")


def blocks():
    return list(BLOCK.finditer(README.read_text(encoding="utf-8")))


def test_there_are_three_commands_with_their_output():
    assert len(blocks()) == 3


@pytest.mark.parametrize("number", range(3))
def test_output(hssh, monkeypatch, request, number):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "100")
    block = blocks()[number]
    answer = hssh(*shlex.split(block["command"])[1:])
    if request.config.getoption("--update-golden"):
        text = README.read_text(encoding="utf-8")
        new = f"```console\n$ {block['command']}\n{answer.out}```"
        README.write_text(text.replace(block[0], new), encoding="utf-8")
        block = blocks()[number]
    assert block["output"] == answer.out


def test_the_trace_is_one():
    (text,) = re.findall(r"```json\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(parse_trace(text)) == 2


def test_what_it_links_to_is_there():
    for link in re.findall(r"\]\(([^)]+)\)", README.read_text(encoding="utf-8")):
        assert (ROOT / link).exists(), link
