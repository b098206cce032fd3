"""A real X server with two monitors, and what is to be seen on them."""
