"""What a plain installation leaves out: which extra brings a package, and what to say where it is missing."""

from __future__ import annotations

from instdrive_core.errors import InstDriveError

EXTRAS = {
    "OpenEXR": "exr",
    "av": "video",
    "cv2": "train",
    "embreex": "train",
    "fsspec": "fleet",
    "google": "serve",
    "grpc": "serve",
    "gsplat": "cuda",
    "laspy": "clouds",
    "lazrs": "clouds",
    "mcap": "mcap",
    "pandas": "train",
    "pyarrow": "datasets",
    "pycocotools": "train",
    "pxr": "usd",
    "pycolmap": "capture",
    "ray": "fleet",
    "scenariogeneration": "openscenario",
    "skimage": "train",
    "torch": "train",
    "transformers": "sam",
}
"""The extra of pyproject.toml that installs a package, by the name under which the package is imported."""


class MissingExtraError(InstDriveError):
    """A command needs packages of an extra that is not installed."""


def explain_missing_module(error: ModuleNotFoundError) -> MissingExtraError | None:
    """Which extra to install for a failed import; None where no extra brings the module."""
    package = (error.name or "").partition(".")[0]
    extra = EXTRAS.get(package)
    if extra is None:
        return None
    return MissingExtraError(f"this needs {package}, which is not installed. Run: pip install 'instdrive[{extra}]'")
