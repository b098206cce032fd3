"""Cameras that speak PTP (ISO 15740), over USB and over TCP: a core without I/O, two transports."""
