"""Small-scale space: arrays in, frozen dataclasses out.

Grids, the local perceptual map (LPM), localisation, skeleton, gateways, the
small-scale star, place detection, log and map readers, and the simulator.
This package knows no logic and never imports ``hssh_kb``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from perception.topology import LocalTopology, local_topology

__all__ = ["LocalTopology", "local_topology"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import on demand, so that ``import perception`` stays quick."""
    if name in __all__:
        from perception import topology

        return getattr(topology, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
