#!/bin/sh
# All that only an NVIDIA GPU can show, in one call of at most ten minutes: builds gsplat, runs the tests marked `gpu`, a
# resumed run, steps at 1M and 5M Gaussians beside gsplat's own trainer, and OpenGL. Writes one JSON file; without a
# GPU its rows say so. Usage: benchmarks/gpu_check.sh [OUT.json] [--help]
cd "$(dirname "$0")/.." || exit
for python in .venv/bin/python python3; do
    if command -v "$python" >/dev/null; then
        exec "$python" -m benchmarks.gpu_check "$@"
    fi
done
echo "gpu_check.sh: no Python found; install Python 3.11 or run 'make lint' first" >&2
exit 1
