"""Plain files out of a knowledge base: JSON, a logic program, a ROS map."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hssh_kb.answers import document_graph, document_maps
from hssh_kb.errors import NoAnswerError, UsageError
from hssh_kb.records import PlaceLayout, Trajectory
from hssh_kb.trace import experience_to_data
from perception.atomic import write_atomically

if TYPE_CHECKING:
    from hssh_kb.kb import KnowledgeBase

ENDINGS = (".json", ".lp", ".pgm")


def check_ending(path: str | Path) -> str:
    """Return the ending of an export's name.

    Raises
    ------
    UsageError : no export has this ending.
    """
    ending = Path(path).suffix.lower()
    if ending not in ENDINGS:
        raise UsageError(f"{path}: cannot export this; the name must end in {', '.join(ENDINGS)}")
    return ending


def export_kb(kb: KnowledgeBase, path: str | Path) -> tuple[Path, ...]:
    """Write a knowledge base, or part of it, to a plain file.

    Parameters
    ----------
    kb : the knowledge base.
    path : ``.json`` for everything but images, ``.lp`` for the experience as facts, ``.pgm`` for
        the global map, with a ``.yaml`` beside it that ROS map_server reads.

    Returns
    -------
    The files written.

    Raises
    ------
    UsageError : another ending.
    NoAnswerError : a ``.pgm`` was asked for, and there is no global map.
    """
    path, ending = Path(path), check_ending(path)
    if ending == ".json":
        document = document_kb(kb)
        text = json.dumps(document, ensure_ascii=False, allow_nan=False)
        write_atomically(path, f"{text}\n".encode())
    elif ending == ".lp":
        from hssh_kb.facts import write_instance

        write_atomically(path, write_instance(kb.experience).encode())
    else:
        return _export_ros_map(kb, path)
    return (path,)


def document_kb(kb: KnowledgeBase) -> dict[str, Any]:
    """Return the ``hssh.kb/1`` document: all of a knowledge base but its images."""
    maps = document_maps(kb.experience, kb.ranked)
    for number, item in enumerate(maps["maps"], 1):
        item |= document_graph(kb.graph(number))
        item["layout"] = _document_layout(kb.layout(number), item["places"])
    record = kb.record
    return {
        "schema": "hssh.kb/1",
        "record": {
            "source": record.source,
            "version": record.version,
            "scans": record.scans,
            "seconds": dict(record.seconds),
            "notices": list(record.notices),
            "options": dict(record.options),
        },
        "experience": experience_to_data(kb.experience),
        "maps": maps,
        "names": {f"v{v}": name for v, name in sorted(kb.names.items())},
        "trajectory": _document_trajectory(kb.trajectory),
    }


def _document_layout(layout: PlaceLayout | None, places: list[Any]) -> dict[str, Any] | None:
    if layout is None:
        return None
    return {
        "chi2": layout.chi2,
        "places": [place["place"] for place in places],
        "poses": layout.poses.round(6).tolist(),
        "covariances": layout.covariances.tolist(),
    }


def _document_trajectory(trajectory: Trajectory | None) -> dict[str, Any] | None:
    if trajectory is None:
        return None
    arrays = {
        "poses": trajectory.poses,
        "times_s": trajectory.times_s,
        "visit_scans": trajectory.visit_scans,
        "odometry": trajectory.odometry,
        "corrected": trajectory.corrected,
    }
    return {
        name: None if array is None else array.round(6).tolist() for name, array in arrays.items()
    }


def _export_ros_map(kb: KnowledgeBase, path: Path) -> tuple[Path, ...]:
    import cv2

    if kb.global_map is None:
        raise NoAnswerError(
            f"there is no global map to write to {path}: this knowledge base was built from a "
            "trace, without scans"
        )
    image, frame = kb.global_map.image, kb.global_map.frame
    bottom_m = frame.top_m - image.shape[0] * frame.resolution_m
    description = path.with_suffix(".yaml")
    write_atomically(path, cv2.imencode(".pgm", image)[1].tobytes())
    text = (
        f"image: {json.dumps(path.name)}\n"
        f"resolution: {frame.resolution_m:.6g}\n"
        f"origin: [{frame.left_m:.6f}, {bottom_m:.6f}, 0.0]\n"
        "negate: 0\n"
        "occupied_thresh: 0.65\n"
        "free_thresh: 0.196\n"
    )
    write_atomically(description, text.encode())
    return path, description
