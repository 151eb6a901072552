"""GLSL sources, shipped as package data of instdrive_app."""
