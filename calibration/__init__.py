"""Fits of what the devices do to the light; knows arrays, no hardware."""
