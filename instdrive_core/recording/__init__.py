"""The edited drive as sensor data: pictures, masks, depth and boxes of every camera and moment, and their layouts.

`plan` says what is recorded, `things` and `boxes` where each instance is, `views` what one camera shows at one
moment, `folder` keeps it on the disk, `record` does all of it and goes on where it was stopped.
"""
