"""Weights of Segment Anything: found in a folder or on the Hugging Face hub, opened by the transformers library."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.json_fields import read_json
from instdrive_core.masks.sam.options import SUGGESTED

if TYPE_CHECKING:
    from torch.nn import Module

CONFIG, WEIGHTS = "config.json", "*.safetensors"
IMAGENET_MEAN, IMAGENET_STD, HALF = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225), (0.5, 0.5, 0.5)
KEEPS_SHAPE = frozenset(("sam", "sam_hq"))
"""Families that pad a photo to a square; the others stretch it."""
HOW_TO_GET = (
    "On a machine with network access, run `hf download {name} --include '*.json' '*.safetensors' "
    "--local-dir weights/sam` (`huggingface-cli download …` in older versions), "
    "copy the folder, and give it as the model: weights/sam"
)


@dataclass(frozen=True)
class PhotoFormat:
    """Form in which a model wants its photos."""

    size: int
    """Edge of the square it looks at, in pixels."""
    keeps_shape: bool
    """Whether a photo keeps its proportions, padded at the right and the bottom, or is stretched to the square."""
    mean: tuple[float, ...]
    std: tuple[float, ...]
    """Deviation of the channels in [0, 1]; what is looked at is (photo − mean) / std."""


def find_weights(model: str, offline: bool) -> Path:
    """Find the folder with the model's files: a local one, or the hub's copy on this machine, downloaded if it is not
    there.

    Args:
        model: a folder, or a name on the hub.
        offline: never ask the network.

    Raises DataError for a folder without such files, OptionError where a name cannot be found or downloaded.
    """
    require_transformers()
    folder = Path(model).expanduser()
    if folder.is_dir():
        missing = [pattern for pattern in (CONFIG, WEIGHTS) if not any(folder.glob(pattern))]
        if missing:
            problem = f"holds no weights that the transformers library reads: '{missing[0]}' is missing"
            raise DataError(folder, problem, HOW_TO_GET.format(name=SUGGESTED))
        return folder
    if model.startswith((".", "/", "~")) or "\\" in model or model.count("/") > 1 or model.count("/") == 0:
        raise DataError(folder, "there is no such folder of weights", HOW_TO_GET.format(name=SUGGESTED))
    return _fetch_from_hub(model, offline)


def require_transformers() -> None:
    """Raise OptionError where the transformers library is not installed."""
    if find_spec("transformers") is None:
        raise OptionError(
            "Masks of Segment Anything need the transformers library, which is not installed. "
            "Run: pip install 'instdrive[sam]'"
        )


def _fetch_from_hub(name: str, offline: bool) -> Path:
    from huggingface_hub import snapshot_download

    reason: Exception | str = "its files are not on this machine, and the network was not to be asked"
    for local in (True,) if offline else (True, False):
        try:
            folder = Path(snapshot_download(name, allow_patterns=["*.json", WEIGHTS], local_files_only=local))
        except (OSError, ValueError) as error:  # the hub's own errors are OSErrors, a malformed name a ValueError
            reason = reason if local else str(error).splitlines()[0]
            continue
        if (folder / CONFIG).is_file() and any(folder.glob(WEIGHTS)):
            return folder
        reason = "it holds no config.json with *.safetensors" if not local else reason
    raise OptionError(
        f"The weights '{name}' cannot be had ({reason}). {HOW_TO_GET.format(name=name)}. "
        f"Families that work: {list_families()}."
    )


def list_families() -> str:
    """List the model types that the installed library generates masks with, for messages."""
    from transformers.models.auto.modeling_auto import MODEL_FOR_MASK_GENERATION_MAPPING_NAMES

    return ", ".join(sorted(MODEL_FOR_MASK_GENERATION_MAPPING_NAMES))


def load_model(folder: Path) -> tuple[Module, PhotoFormat]:
    """Open a model, in 32-bit floats on the CPU, and how it wants its photos.

    Raises DataError where its files are damaged, incomplete or of a model that does not generate masks, OptionError
    where it needs a package that is not installed.
    """
    from transformers import AutoModelForMaskGeneration
    from transformers.models.auto.modeling_auto import MODEL_FOR_MASK_GENERATION_MAPPING_NAMES

    file = folder / CONFIG
    config = read_json(file)
    kind = config.get("model_type") if isinstance(config, dict) else None
    if kind not in MODEL_FOR_MASK_GENERATION_MAPPING_NAMES:
        remedy = f"Families that work with the installed transformers: {list_families()}, e.g. {SUGGESTED}"
        raise DataError(file, f"is of a model of the type {kind!r}, which does not generate masks", remedy)
    try:
        with _silence_progress_bars():
            model, report = AutoModelForMaskGeneration.from_pretrained(
                folder, local_files_only=True, use_safetensors=True, output_loading_info=True
            )
    except ImportError as error:
        raise OptionError(f"The model in {folder} needs a package that is not installed: {error}") from error
    except Exception as error:  # anything may come out of files that others wrote
        remedy = HOW_TO_GET.format(name=SUGGESTED)
        raise DataError(folder, f"cannot be opened as a model of the type '{kind}' ({error})", remedy) from error
    if report["missing_keys"]:
        problem = f"lacks {len(report['missing_keys'])} of the model's weights, e.g. '{min(report['missing_keys'])}'"
        raise DataError(folder, problem, HOW_TO_GET.format(name=SUGGESTED))
    return model.float().eval(), _read_photo_format(folder, kind, model.config.prompt_encoder_config.image_size)


def _read_photo_format(folder: Path, kind: str, size: int | list[int]) -> PhotoFormat:
    """Read what the model's own files say about photos; where they say nothing, what its family is used to."""
    settings: dict[str, Any] = {}
    for name in ("preprocessor_config.json", "processor_config.json"):
        if (folder / name).is_file():
            found = read_json(folder / name)
            found = found.get("image_processor", found) if isinstance(found, dict) else {}
            settings = {**found, **settings}
    usual_mean, usual_std = (HALF, HALF) if kind.startswith("sam3") else (IMAGENET_MEAN, IMAGENET_STD)
    mean, std = settings.get("image_mean") or usual_mean, settings.get("image_std") or usual_std
    edge = size if isinstance(size, int) else max(size)
    return PhotoFormat(edge, kind in KEEPS_SHAPE, tuple(map(float, mean)), tuple(map(float, std)))


@contextmanager
def _silence_progress_bars() -> Iterator[None]:
    """Silence the library's progress bars: the program has its own."""
    from transformers.utils import logging

    shown = logging.is_progress_bar_enabled()
    logging.disable_progress_bar()
    try:
        yield
    finally:
        if shown:
            logging.enable_progress_bar()
