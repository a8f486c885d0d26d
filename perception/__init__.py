"""Small-scale space: arrays in, frozen dataclasses out.

Grids, the local perceptual map (LPM), localisation, skeleton, gateways, the
small-scale star, place detection, log and map readers, and the simulator.
This package knows no logic and never imports ``hssh_kb``.
"""
