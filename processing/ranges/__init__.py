"""The default decomposition: light by the range over which it travelled."""
