"""Projectors and cameras, real and simulated, and the decoding of what a camera delivers."""
