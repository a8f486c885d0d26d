"""Golden files: ``pytest --update-golden`` rewrites them, to be read before they are committed."""

import json
from pathlib import Path

import pytest

GOLDEN = Path(__file__).parent / "golden"


def pytest_addoption(parser):
    parser.addoption(
        "--update-golden", action="store_true", help="rewrite the golden files instead of comparing"
    )


@pytest.fixture
def golden(request):
    """Compare plain data with a golden JSON file."""

    def compare(name, data):
        path = GOLDEN / name
        if request.config.getoption("--update-golden"):
            text = json.dumps(data, indent=1, ensure_ascii=False, sort_keys=True)
            path.write_text(text + "\n", encoding="utf-8")
        assert json.loads(path.read_text(encoding="utf-8")) == data

    return compare


@pytest.fixture
def traces():
    """The folder of the reference traces."""
    return Path(__file__).parent / "traces"
