"""From frames to direct and global light pitch by pitch, with their noise and drift."""
