"""Where the public test data lie: beside the checkout, or where HSSH_DATA says."""

from __future__ import annotations

import os
from pathlib import Path


def data_path(*parts: str) -> Path | None:
    """Return the path of a data file, None (told in words) where it is absent."""
    root = os.environ.get("HSSH_DATA")
    base = Path(root) if root else Path(__file__).resolve().parents[3] / "shared" / "data"
    path = base.joinpath(*parts)
    if path.exists():
        return path
    print(f"skipped: {'/'.join(parts)} is not in the data folder (set HSSH_DATA)")
    return None
