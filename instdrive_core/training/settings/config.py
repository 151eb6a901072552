"""Settings of a training run, and the presets and methods that fill them in."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal

Method = Literal["instdrive", "paper", "mask-graph", "gaussian-grouping", "opengaussian"]
LEARNED_ELSEWHERE = ("mask-graph", "gaussian-grouping", "opengaussian")
"""Methods whose instance stage is not the trainer's."""
Preset = Literal["demo", "quick", "paper"]
Device = Literal["auto", "cpu", "cuda"]
PieceChoice = Literal["auto"] | int
"""Number of pieces that a drive is cut into; `auto` = as many as it needs."""


@dataclass(frozen=True)
class InitConfig:
    """Sources of the first Gaussians (drivestudio's Street-Gaussians configuration, scaled down)."""

    lidar_points: int = 150_000
    """LiDAR points kept for the background, after voxel thinning."""
    near_points: int = 15_000
    """Random points around the cameras, where LiDAR sees nothing."""
    far_points: int = 15_000
    """Random points far out, in inverse distance."""
    actor_points: int = 3_000
    """Largest number of points per moving object."""
    opacity: float = 0.1
    """First opacity."""
    moving_actors: bool = True
    """Moving objects become nodes of their own; off: everything is background (static-only)."""


@dataclass(frozen=True)
class GeometryConfig:
    """The RGB stage: appearance and shape.

    Rates are four times those of 3DGS: Adam moves only what a view sees, and a drive's Gaussian is seen by one view in
    five to ten (measured: docs/engine.md).
    """

    iterations: int = 4_500
    """Steps of one image each."""
    coarse_iterations: int = 500
    """First steps, counted in `iterations`, that run at half the resolution."""
    sh_degree: int = 1
    """Degree of the spherical harmonics, 0 to 3."""
    ssim_weight: float = 0.2
    """RGB term: (1 - w) L1 + w (1 - SSIM)."""
    depth_weight: float = 0.02
    """LiDAR depth, L1 in metres below 80 m."""
    sky_weight: float = 0.05
    """Opacity inside the sky mask."""
    solid_weight: float = 0.05
    """Opacity inside instance masks: the sky must not paint what is far off; 0 = none."""
    means_lr: float = 6.4e-4
    """Times the scene radius; falls exponentially to a hundredth."""
    sh_dc_lr: float = 0.01
    """Constant colour."""
    sh_rest_lr: float = 5e-4
    """View-dependent colour."""
    opacity_lr: float = 0.2
    """Opacity logits."""
    scale_lr: float = 0.02
    """Log scales."""
    rotation_lr: float = 4e-3
    """Quaternions."""
    edge_weight: float = 0.3
    """Edges of the masks: what shows of other objects in an object's masks; 0 = none."""
    edge_start: float = 0.75
    """Share of the stage after which edges are learned, once nothing grows any more."""
    edge_fit: float = 0.5
    """Masks whose IoU with the object they show best is smaller teach no edges."""
    sky_lr: float = 0.01
    """Sky cube map."""
    sky_resolution: int = 128
    """Texels along one side of a cube face."""
    exposure_lr: float = 5e-3
    """Affine exposure of each photo; 0 = none."""
    exposure_weight: float = 0.1
    """Pull of the exposures towards the identity, singly and in the mean."""
    rig_lr: float = 5e-4
    """Corrections of where each camera sits on the vehicle, metres; turns a tenth of it, radians; 0 = as calibrated."""
    photo_lr: float = 2e-3
    """Corrections of each photo's pose beside its camera's, likewise; 0 = none."""
    photo_decay: float = 0.01
    """Share of the way to zero that a photo's own correction goes back at each of its steps."""
    track_lr: float = 3e-3
    """Corrections of the cuboid tracks, metres and radians; 0 = tracks stay as given."""
    track_decay: float = 1e-3
    """Share of the way to zero that a pose's correction goes back at each of its steps."""


@dataclass(frozen=True)
class DensifyConfig:
    """Growing and pruning, as gsplat's default strategy with absolute gradients (3DGS, sec. 5.2; AbsGS)."""

    max_gaussians: int = 300_000
    """Nothing grows beyond this many; 0 = no growing and no pruning."""
    start: int = 500
    """First step that may grow."""
    stop: float = 0.5
    """Share of the RGB stage after which nothing grows and nothing is pruned any more."""
    every: int = 100
    """Steps between two refinements."""
    gradient_threshold: float = 8e-4
    """Mean absolute screen-space gradient (coordinates in [-1, 1]) above which a Gaussian grows."""
    clone_scale: float = 0.01
    """Up to this share of the scene radius a Gaussian is cloned, above it split in two."""
    prune_opacity: float = 0.005
    """Fainter Gaussians are removed."""
    prune_scale: float = 0.1
    """Gaussians larger than this share of the scene radius are removed, once opacities have been reset."""
    reset_every: int = 3_000
    """Steps between two resets of the opacities to twice `prune_opacity`."""


@dataclass(frozen=True)
class InstanceConfig:
    """The instance losses (InstDrive, sec. 3.2 and 3.3). Defaults are ours; `--method paper` sets the printed forms."""

    learned_by: Literal["votes", "losses"] = "votes"
    """`votes`: the affinity graph of the masks and weighted votes, no gradients. `losses`: features are trained, and
    all settings below apply."""
    schedule: Literal["after", "joint"] = "after"
    """`after`: on frozen geometry with cached blending weights. `joint`: in every RGB step, as printed."""
    iterations: int = 2_500
    """Steps of the `after` schedule; `joint` follows the RGB stage's."""
    feature_dim: int = 16
    """d of the codebook {-1, 1}^d."""
    tanh: bool = True
    """Losses act on tanh of the rendered feature; off: on the raw feature."""
    repulsion_offset: float = 1.0
    """ε in the inter-mask term 1 / (distance² + ε)."""
    init_std: float = 0.1
    """Standard deviation of the first features."""
    feature_lr: float = 0.05
    """Adam's step for features."""
    contrastive_weight: float = 0.1
    """Pull inside a mask, push between masks of one image."""
    voxel_weight: float = 1.0
    """Agreement inside randomly shifted voxels."""
    pseudo_weight: float = 0.3
    """Towards the codeword that wins the vote inside each mask."""
    pseudo_start: float = 1 / 3
    """Share of the run after which pseudo supervision begins."""
    voxel_every: int = 5
    """Steps between two voxel losses."""
    voxel_size: float = 1.0
    """Metres. The paper's 0.5 m leaves large surfaces in more pieces (docs/method.md)."""
    pixels_per_view: int = 4_096
    """Pixels per step, stratified over masks; `joint` samples them from the rendered map."""
    min_alpha: float = 0.5
    """Pixels with less accumulated opacity are left out."""
    whole_actors: bool = True
    """A moving object is one instance, whatever the codewords of its Gaussians."""


@dataclass(frozen=True)
class GraphConfig:
    """Instances without training: patches, merging, votes (docs/method.md has the figures behind the defaults)."""

    min_weight: float = 0.1
    """Gaussians with less blending weight in all masks count as unseen."""
    neighbors: int = 10
    """Neighbours of each Gaussian that it may form a patch with."""
    patch_agreement: float = 0.7
    """Least agreement of two Gaussians of a patch."""
    patch_size: int = 60
    """Most Gaussians of a patch."""
    merge_agreements: tuple[float, ...] = (0.9, 0.8, 0.7, 0.6, 0.5)
    """Falling thresholds of the merging."""
    vote_rounds: int = 10
    """Most rounds of naming masks and Gaussians in turn."""
    vote_tolerance: float = 1e-4
    """Share of Gaussians that change, below which voting ends."""
    majority: float = 0.7
    """Share of its votes for which a Gaussian leaves the group of its patch, where masks leave out as much as
    segmenters do (`get_majority`)."""
    min_fit: float = 0.2
    """Groups that fit their masks less (mean of the best IoU per photo) are fragments and are given away."""
    min_silence: float = 0.02
    """Weight in no mask, as a multiple of that in masks, from which on LiDAR's things count like the masks of one more
    photo."""
    lidar_reach: float = 0.3
    """Metres from a LiDAR point within which Gaussians belong to its thing: as far as its points hang together."""
    max_unmasked: float = 0.9
    """Gaussians that show more than this share of their weight where no mask is take the ID of similar neighbours; 1 =
    none do."""
    similar_neighbors: int = 16
    """Neighbours among which the most similar one is chosen."""

    def get_majority(self, silence: float) -> float:
        """Get the share of its votes for which a Gaussian leaves the group of its patch.

        Masks that cover everything err here and there, and what most of them say is right. A segmenter leaves a third
        of a photo out, the same in each photo: there hardly any mask speaks for a Gaussian but those beside it, and its
        patch knows better.

        Args:
            silence: weight in no mask, as a multiple of that in masks; from 0.5 on, `majority` holds in full.
        """
        return self.majority * min(1.0, 2 * silence)


@dataclass(frozen=True)
class TrainConfig:
    """One training run, complete: same config, seed and thread count give the same bits."""

    method: Method = "instdrive"
    preset: Preset = "quick"
    seed: int = 0
    init: InitConfig = field(default_factory=InitConfig)
    geometry: GeometryConfig = field(default_factory=GeometryConfig)
    densify: DensifyConfig = field(default_factory=DensifyConfig)
    instances: InstanceConfig = field(default_factory=InstanceConfig)
    graph: GraphConfig = field(default_factory=GraphConfig)
    freeze_geometry: bool = False
    """Learn instances only, on the Gaussians that the run starts from."""
    checkpoint_every: int = 500
    """Steps between points where the run is saved, if enough time has passed (`training.checkpoint_pace`)."""
    report_every: int = 10
    """Steps between two progress events."""

    @property
    def trains_features(self) -> bool:
        """Whether the trainer learns a feature per Gaussian; votes and methods learned elsewhere need none of it."""
        return self.instances.learned_by == "losses" and self.method not in LEARNED_ELSEWHERE

    @property
    def trained_feature_dim(self) -> int:
        """Numbers of each Gaussian's trained feature: 0 where none is trained, so that none takes memory."""
        return self.instances.feature_dim if self.trains_features else 0

    @property
    def learns_edges(self) -> bool:
        """Whether masks shape Gaussians, too: with our own method, whose votes tell which masks show one object."""
        ours = self.method == "instdrive" and self.instances.learned_by == "votes"
        return ours and self.geometry.edge_weight > 0 and not self.freeze_geometry

    @property
    def instance_iterations(self) -> int:
        """Steps of the instance stage that follows the RGB stage."""
        return self.instances.iterations if self.trains_features and self.instances.schedule == "after" else 0

    def to_json(self) -> dict[str, Any]:
        """Nested plain values that `from_json` reads."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> TrainConfig:
        """Read a configuration back from what `to_json` wrote."""
        return TrainConfig(
            **{
                **values,
                "init": InitConfig(**values["init"]),
                "geometry": GeometryConfig(**values["geometry"]),
                "densify": DensifyConfig(**values["densify"]),
                "instances": InstanceConfig(**values["instances"]),
                "graph": GraphConfig(
                    **values["graph"] | {"merge_agreements": tuple(values["graph"]["merge_agreements"])}
                ),
            }
        )


def use_printed_losses(instances: InstanceConfig) -> InstanceConfig:
    """Set the paper's own choices: raw features, 1/d² (ε = 1e-4), weights 0.1, d = 8, trained with the RGB term.

    The paper tells no learning rate; features take that of 3DGS for colours.
    """
    return replace(
        instances,
        learned_by="losses",
        schedule="joint",
        feature_dim=8,
        tanh=False,
        repulsion_offset=1e-4,
        feature_lr=2.5e-3,
        contrastive_weight=0.1,
        voxel_weight=0.1,
        voxel_size=0.5,
        pseudo_weight=0.1,
        whole_actors=False,
    )


def use_long_run_rates(geometry: GeometryConfig) -> GeometryConfig:
    """Set the learning rates of 3DGS, for runs as long as its own."""
    return replace(
        geometry,
        means_lr=1.6e-4,
        sh_dc_lr=2.5e-3,
        sh_rest_lr=1.25e-4,
        opacity_lr=0.05,
        scale_lr=5e-3,
        rotation_lr=1e-3,
    )


def build_train_config(method: Method = "instdrive", preset: Preset = "quick", seed: int = 0) -> TrainConfig:
    """Build the configuration behind `--method` and `--preset`."""
    config = TrainConfig(method=method, preset=preset, seed=seed)
    if preset == "demo":
        config = replace(
            config,
            init=InitConfig(lidar_points=100_000, near_points=10_000, far_points=10_000, actor_points=2_000),
            geometry=replace(config.geometry, iterations=2_200, coarse_iterations=250),
            densify=replace(config.densify, max_gaussians=180_000),
            instances=replace(config.instances, iterations=1_500),
        )
    elif preset == "paper":
        config = replace(
            config,
            init=InitConfig(lidar_points=800_000, near_points=100_000, far_points=100_000, actor_points=5_000),
            geometry=use_long_run_rates(replace(config.geometry, iterations=30_000, coarse_iterations=0, sh_degree=3)),
            densify=replace(config.densify, max_gaussians=1_500_000),
            instances=replace(config.instances, iterations=10_000),
        )
    if method == "paper":
        config = replace(config, instances=use_printed_losses(config.instances))
    return config


def keep_cameras(config: TrainConfig) -> TrainConfig:
    """Copy a configuration so that photos keep their poses: fitted to the photos already, in a unit of its own."""
    return replace(config, geometry=replace(config.geometry, rig_lr=0.0, photo_lr=0.0))


def keep_geometry(config: TrainConfig) -> TrainConfig:
    """Copy a configuration so that it learns instances alone, on the geometry that the run starts from.

    The `joint` schedule keeps its losses and its number of steps, on cached blending weights.
    """
    instances = config.instances
    if instances.schedule == "joint":
        instances = replace(instances, schedule="after", iterations=config.geometry.iterations)
    return replace(config, freeze_geometry=True, instances=instances)
