"""What moves in scenes of other trainers: whose box it is put into, and where its data set says that it was."""
