"""From photos, a video or a drive to a measured scene: stages of one job, which other programs can watch and stop."""
