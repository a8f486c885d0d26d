"""Pictures and exports never take the place of what a knowledge base was built from."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from hssh_kb.cli import main


@pytest.fixture
def folder(tmp_path, monkeypatch):
    image = np.zeros((200, 300), np.uint8)
    image[20:50, 20:280] = image[50:180, 120:150] = 254
    for ending in ("png", "pgm"):
        cv2.imwrite(str(tmp_path / f"office.{ending}"), image)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def build(ending):
    sheet = f"image: office.{ending}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: 0\n"
    Path("office.yaml").write_text(sheet + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    assert main(["build", "office.yaml", "-o", "office.hssh"]) == 0


def test_the_image_of_the_map_is_not_drawn_over(folder, capsys):
    build("png")
    before = (folder / "office.png").read_bytes()
    assert main(["show", "office.hssh", "-o", "office.png"]) == 2
    assert "is the image of the map office.yaml" in capsys.readouterr().err
    assert (folder / "office.png").read_bytes() == before
    for _ in range(2):  # what was drawn before may be drawn again
        assert main(["show", "office.hssh", "-o", "map.png"]) == 0


def test_an_export_spares_the_map_too(folder, capsys, monkeypatch):
    build("pgm")
    before = [(folder / name).read_bytes() for name in ("office.pgm", "office.yaml")]
    (folder / "elsewhere").mkdir()
    assert main(["export", "office.hssh", "-o", "office.pgm"]) == 2
    monkeypatch.chdir(folder / "elsewhere")
    assert main(["export", "../office.hssh", "-o", "../office.pgm"]) == 2
    assert "choose another name" in capsys.readouterr().err
    assert [(folder / name).read_bytes() for name in ("office.pgm", "office.yaml")] == before
    for _ in range(2):
        assert main(["export", "../office.hssh", "-o", "grid.pgm"]) == 0
