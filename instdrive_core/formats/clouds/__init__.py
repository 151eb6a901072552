"""Point clouds of scanners, opened as small round splats: .las and .laz (extra `clouds`), .pcd, .ply without splats."""
