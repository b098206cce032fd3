"""The firmware, run on this computer."""
