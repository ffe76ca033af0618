//! The schemas: name and text, as far as tools need them to know a message's fields.

/// Name and JSON schema.
type Schema = (&'static str, &'static str);

/// A turn of a laser.
pub const LASER_SCAN: Schema = ("foxglove.LaserScan", include_str!("schemas/LaserScan.json"));
/// Where something is.
pub const POSE_IN_FRAME: Schema = ("foxglove.PoseInFrame", include_str!("schemas/PoseInFrame.json"));
/// Where frames are.
pub const FRAME_TRANSFORMS: Schema = ("foxglove.FrameTransforms", include_str!("schemas/FrameTransforms.json"));
/// A map.
pub const GRID: Schema = ("foxglove.Grid", include_str!("schemas/Grid.json"));
/// Points.
pub const POINT_CLOUD: Schema = ("foxglove.PointCloud", include_str!("schemas/PointCloud.json"));
/// Words.
pub const LOG: Schema = ("foxglove.Log", include_str!("schemas/Log.json"));
