"""Images as rows, and arithmetic whose bits no processor changes."""
