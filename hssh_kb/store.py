"""The ``.hssh`` file: one SQLite database, written whole or not at all, checked when read.

Tables: ``meta`` (schema, ranking, record), ``experience`` (the trace document), ``hypotheses``,
``layouts``, ``lpms`` and ``global_map`` (PNG images with their frames), ``trajectory`` (arrays),
``names``. Arrays are zlib-compressed ``.npy`` blobs.
"""

from __future__ import annotations

import io
import json
import sqlite3
import zlib
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hssh_kb.errors import InputError
from hssh_kb.experience import Experience
from hssh_kb.hypothesis import Hypothesis
from hssh_kb.kb import KnowledgeBase
from hssh_kb.ranking import RankedMaps
from hssh_kb.records import BuildRecord, PlaceLayout, Raster, Trajectory
from hssh_kb.trace import experience_from_data, experience_to_data, load_trace
from perception.atomic import replace_file
from perception.files import looks_like_json
from perception.grid import Frame

SCHEMA = "hssh.kb/1"
SCHEMA_VERSION = 1
APPLICATION_ID = int.from_bytes(b"hssh", "big")
_MAGIC = b"SQLite format 3\0"
_TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE experience (document TEXT NOT NULL);
CREATE TABLE hypotheses (number INTEGER PRIMARY KEY, document TEXT NOT NULL);
CREATE TABLE layouts (
    number INTEGER PRIMARY KEY, poses BLOB NOT NULL, covariances BLOB NOT NULL, chi2 REAL NOT NULL);
CREATE TABLE lpms (
    visit INTEGER PRIMARY KEY, png BLOB NOT NULL,
    left_m REAL NOT NULL, top_m REAL NOT NULL, resolution_m REAL NOT NULL);
CREATE TABLE global_map (
    png BLOB NOT NULL, left_m REAL NOT NULL, top_m REAL NOT NULL, resolution_m REAL NOT NULL);
CREATE TABLE trajectory (name TEXT PRIMARY KEY, array BLOB NOT NULL);
CREATE TABLE names (visit INTEGER PRIMARY KEY, name TEXT NOT NULL);
"""
_TABLE_NAMES = {
    "meta",
    "experience",
    "hypotheses",
    "layouts",
    "lpms",
    "global_map",
    "trajectory",
    "names",
}


def is_knowledge_base(path: str | Path) -> bool:
    """Say by content, not by name, whether a file is a knowledge base (an SQLite file).

    Raises
    ------
    InputError : the file is missing, a directory, or cannot be read.
    """
    path = Path(path)
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except IsADirectoryError:
        raise InputError(
            f"{path}: is a directory; give a knowledge base (.hssh) or a trace (JSON)"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None


def read_kb_or_trace(path: str | Path) -> KnowledgeBase | Experience:
    """Read a knowledge base or a trace, told apart by content.

    Raises
    ------
    InputError : neither of the two, or damaged; says what to do.
    """
    if is_knowledge_base(path):
        return load_kb(path)
    if Path(path).stat().st_size and not looks_like_json(path) and not _is_blank(path):
        raise InputError(
            f"{path}: is neither a knowledge base nor a trace (JSON); a log becomes a knowledge "
            f"base with 'hssh build {path}'"
        )
    return load_trace(path)


def _is_blank(path: str | Path) -> bool:
    return not Path(path).read_bytes().strip()


def save_kb(kb: KnowledgeBase, path: str | Path) -> None:
    """Write a knowledge base to one file; a kill at any moment leaves the old one or the new one.

    Raises
    ------
    InputError : the folder does not exist or cannot be written to.
    """
    with replace_file(path) as temporary:
        try:
            with closing(sqlite3.connect(temporary)) as db:
                # The temporary file is synced and moved as a whole: SQLite need not journal.
                db.execute("PRAGMA journal_mode = OFF")
                db.execute("PRAGMA synchronous = OFF")
                db.executescript(_TABLES)
                _write_kb(db, kb)
                db.execute(f"PRAGMA application_id = {APPLICATION_ID}")
                db.execute(f"PRAGMA user_version = {SCHEMA_VERSION}")
                db.commit()
        except sqlite3.OperationalError as error:
            raise InputError(f"{path}: cannot be written ({error})") from None


def load_kb(path: str | Path) -> KnowledgeBase:
    """Read and check a knowledge base file.

    Raises
    ------
    InputError : missing, not a knowledge base, cut short, damaged, or of a newer schema; says
        which, and what to do.
    """
    path = Path(path)
    if not is_knowledge_base(path):
        raise InputError(
            f"{path}: is not a knowledge base file; make one with 'hssh build INPUT -o {path}'"
        )
    _check_length(path)
    uri = path.resolve().as_uri() + "?mode=ro"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as db:
            _check_database(db, path)
            return _read_kb(db)
    except sqlite3.Error as error:
        raise InputError(f"{path}: the file is damaged ({error}); {_REMEDY}") from None
    except InputError as error:
        known = str(error).startswith(str(path))
        raise InputError(str(error) if known else f"{path}: {error}; {_REMEDY}") from None
    except (ValueError, KeyError, TypeError, zlib.error, EOFError) as error:
        raise InputError(
            f"{path}: the file is damaged ({type(error).__name__}: {error}); {_REMEDY}"
        ) from None


_REMEDY = "build it again with 'hssh build' or restore a copy"


def _check_length(path: Path) -> None:
    with path.open("rb") as file:
        header = file.read(100)
    size = path.stat().st_size
    if len(header) < 100:
        raise InputError(f"{path}: the file is cut short after {size} bytes; {_REMEDY}")
    page = int.from_bytes(header[16:18], "big")
    expected = (65536 if page == 1 else page) * int.from_bytes(header[28:32], "big")
    if size < expected:
        raise InputError(
            f"{path}: the file is cut short, it holds {size} of {expected} bytes "
            f"(an unfinished copy or download?); {_REMEDY}"
        )


def _check_database(db: sqlite3.Connection, path: Path) -> None:
    application = db.execute("PRAGMA application_id").fetchone()[0]
    if application != APPLICATION_ID:
        raise InputError(
            f"{path}: is an SQLite database of another program, not a knowledge base; "
            "make one with 'hssh build INPUT'"
        )
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version > SCHEMA_VERSION:
        raise InputError(
            f"{path}: has schema version {version}, this program reads up to {SCHEMA_VERSION}; "
            "install a newer hssh, or build the file again"
        )
    fault = db.execute("PRAGMA quick_check(1)").fetchone()[0]
    if fault != "ok":
        raise InputError(f"{path}: the file is damaged ({fault}); {_REMEDY}")
    tables = {row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
    if missing := sorted(_TABLE_NAMES - tables):
        raise InputError(f"{path}: lacks the table {', '.join(missing)}; {_REMEDY}")


def _write_kb(db: sqlite3.Connection, kb: KnowledgeBase) -> None:
    ranked = kb.ranked
    meta = {
        "schema": SCHEMA,
        "ranking": {
            "ranked_by": ranked.ranked_by,
            "minimality": ranked.minimality,
            "consistent": ranked.consistent,
            "proven": ranked.proven,
            "inconsistent_from": ranked.inconsistent_from,
            "budget_spent": ranked.budget_spent,
            "policy": ranked.policy,
            "log_evidence": ranked.log_evidence,
            "contradiction": ranked.contradiction,
        },
        "record": asdict(kb.record),
        "experience": {"source": kb.experience.source, "notices": kb.experience.notices},
    }
    _insert(db, "meta", ((key, _dump(value)) for key, value in meta.items()))
    _insert(db, "experience", [(_dump(experience_to_data(kb.experience)),)])
    _insert(db, "hypotheses", ((n, _dump(hypothesis_to_data(h))) for n, h in _number(ranked.maps)))
    _insert(
        db,
        "layouts",
        (
            (n, _pack(layout.poses), _pack(layout.covariances), float(layout.chi2))
            for n, layout in _number(kb.layouts)
            if layout is not None
        ),
    )
    _insert(db, "lpms", ((int(v), *_pack_raster(tile)) for v, tile in sorted(kb.lpms.items())))
    if kb.global_map is not None:
        _insert(db, "global_map", [_pack_raster(kb.global_map)])
    if kb.trajectory is not None:
        arrays = {
            name: getattr(kb.trajectory, name)
            for name in ("poses", "times_s", "visit_scans", "odometry", "corrected")
        }
        _insert(db, "trajectory", ((n, _pack(a)) for n, a in arrays.items() if a is not None))
    _insert(db, "names", ((int(v), name) for v, name in sorted(kb.names.items())))


def _insert(db: sqlite3.Connection, table: str, rows: Iterable[tuple[Any, ...]]) -> None:
    for row in rows:
        marks = ", ".join("?" * len(row))
        db.execute(f"INSERT INTO {table} VALUES ({marks})", row)


def _number(items: Iterable[Any]) -> Iterable[tuple[int, Any]]:
    return enumerate(items, 1)


def _read_kb(db: sqlite3.Connection) -> KnowledgeBase:
    meta = {key: json.loads(value) for key, value in db.execute("SELECT key, value FROM meta")}
    document = json.loads(db.execute("SELECT document FROM experience").fetchone()[0])
    told = meta["experience"]
    experience = experience_from_data(document, told["source"] or "experience")
    ranking = meta["ranking"]
    maps = tuple(
        hypothesis_from_data(json.loads(text))
        for (text,) in db.execute("SELECT document FROM hypotheses ORDER BY number")
    )
    layouts: list[PlaceLayout | None] = [None] * len(maps)
    for number, poses, covariances, chi2 in db.execute(
        "SELECT number, poses, covariances, chi2 FROM layouts"
    ):
        layouts[number - 1] = PlaceLayout(_unpack(poses), _unpack(covariances), chi2)
    lpms = {row[0]: _unpack_raster(*row[1:]) for row in db.execute("SELECT * FROM lpms")}
    drawn = db.execute("SELECT * FROM global_map").fetchone()
    arrays = {
        name: _unpack(blob) for name, blob in db.execute("SELECT name, array FROM trajectory")
    }
    record = dict(meta["record"])
    record["notices"] = tuple(record["notices"])
    return KnowledgeBase(
        experience,
        RankedMaps(maps, **ranking),
        tuple(layouts) if any(layouts) else (),
        lpms,
        Trajectory(**arrays) if arrays else None,
        _unpack_raster(*drawn) if drawn else None,
        dict(db.execute("SELECT visit, name FROM names")),
        BuildRecord(**record),
    )


def hypothesis_to_data(hypothesis: Hypothesis) -> dict[str, Any]:
    """Return a hypothesis ready for JSON."""
    return {
        "visits": list(hypothesis.visits),
        "offsets": list(hypothesis.offsets),
        "readings": list(hypothesis.readings),
        "log_posterior": hypothesis.log_posterior,
        "terms": dict(hypothesis.terms),
        "doubted": list(hypothesis.doubted),
    }


def hypothesis_from_data(data: Mapping[str, Any]) -> Hypothesis:
    """Return the hypothesis that :func:`hypothesis_to_data` wrote."""
    return Hypothesis(
        tuple(data["visits"]),
        tuple(data["offsets"]),
        tuple(data["readings"]),
        data["log_posterior"],
        dict(data["terms"]),
        tuple(data["doubted"]),
    )


def _dump(value: Any) -> str:  # noqa: ANN401
    return json.dumps(value, ensure_ascii=False, default=_to_plain)


def _to_plain(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, np.generic):
        return value.item()
    return list(value) if isinstance(value, tuple | np.ndarray) else str(value)


def _pack(array: Any) -> bytes:  # noqa: ANN401
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array), allow_pickle=False)
    return zlib.compress(buffer.getvalue(), 6)


def _unpack(blob: bytes) -> Any:  # noqa: ANN401
    return np.load(io.BytesIO(zlib.decompress(blob)), allow_pickle=False)


def _pack_raster(raster: Raster) -> tuple[bytes, float, float, float]:
    import cv2

    frame = raster.frame
    png = cv2.imencode(".png", raster.image)[1].tobytes()
    return png, float(frame.left_m), float(frame.top_m), float(frame.resolution_m)


def _unpack_raster(png: bytes, left_m: float, top_m: float, resolution_m: float) -> Raster:
    import cv2

    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        raise ValueError("an image in it cannot be decoded")
    return Raster(image.astype(np.uint8), Frame(left_m, top_m, resolution_m))
