"""Ranges of light from stripes in two positions a pitch: a pattern and its complement."""
