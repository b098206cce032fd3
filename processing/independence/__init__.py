"""The paper's decomposition: independent vector analysis of the direct images."""
