"""Whether every frame shows what it should."""
