"""Names of the columns in version 2 of the Waymo Open Dataset: each component is a folder of parquet files."""

SEGMENT, TIME = "key.segment_context_name", "key.frame_timestamp_micros"
CAMERA, LASER, OBJECT = "key.camera_name", "key.laser_name", "key.laser_object_id"
IMAGE = "[CameraImageComponent].image"
IMAGE_POSE, IMAGE_TIME = "[CameraImageComponent].pose.transform", "[CameraImageComponent].pose_timestamp"
_CAMERA = "[CameraCalibrationComponent]"
LENS = tuple(f"{_CAMERA}.intrinsic.{name}" for name in ("f_u", "f_v", "c_u", "c_v", "k1", "k2", "p1", "p2", "k3"))
SIZE = (f"{_CAMERA}.width", f"{_CAMERA}.height")
CAMERA_PLACE = f"{_CAMERA}.extrinsic.transform"
CAR_POSE = "[VehiclePoseComponent].world_from_vehicle.transform"
_LASER = "[LiDARCalibrationComponent]"
LASER_PLACE = f"{_LASER}.extrinsic.transform"
BEAM_LIMITS = (f"{_LASER}.beam_inclination.min", f"{_LASER}.beam_inclination.max")
BEAMS = f"{_LASER}.beam_inclination.values"
RETURNS = tuple(f"[LiDARComponent].range_image_return{number}" for number in (1, 2))
PIXEL_POSES = "[LiDARPoseComponent].range_image_return1"
_BOX = "[LiDARBoxComponent]"
BOX = (
    *(f"{_BOX}.box.center.{axis}" for axis in "xyz"),
    *(f"{_BOX}.box.size.{axis}" for axis in "xyz"),
    f"{_BOX}.box.heading",
)
BOX_TYPE = f"{_BOX}.type"
CAMERAS = ("FRONT", "FRONT_LEFT", "FRONT_RIGHT", "SIDE_LEFT", "SIDE_RIGHT")
"""By number, from 1."""
TYPES = ("Unknown", "Vehicle", "Pedestrian", "Sign", "Cyclist")
TOP = 1
"""The spinning LiDAR on the roof."""
