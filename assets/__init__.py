"""Icon, font and sample scene, shipped as package data of instdrive_app."""
