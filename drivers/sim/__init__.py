"""A bench of physics: scenes whose light is known exactly, seen through simulated devices."""
