"""A simulated PTP camera that others accept: a body like the Nikon D4S, over any transport.

`responder` is the camera without I/O, `server` puts it on TCP; a USB gadget can be put around the
same `Responder.handle`. What takes long to import is injected: simulated scenes
(`scenery`) and the reading of raw files (`darkroom`).
"""
