"""Scene bundles of splatsim and Autoware's 3dgs_io: a ``.usdz`` with ``scene.json``, ``.spz`` chunks and actors."""
