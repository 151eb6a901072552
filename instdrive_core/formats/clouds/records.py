"""The cloud formats as records; a .ply says by its columns what it holds."""

from __future__ import annotations

from instdrive_core.formats.clouds.las import read_las
from instdrive_core.formats.clouds.pcd import read_pcd
from instdrive_core.formats.scene_format import Format

LAS = Format("LiDAR points, ASPRS", ".las", read_las, up="+z")
LAZ = Format("LiDAR points, compressed", ".laz", read_las, up="+z")
PCD = Format("Points of PCL", ".pcd", read_pcd, up="+z")
