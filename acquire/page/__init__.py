"""The page at the bench: what a person looks at while aiming, focusing and waiting.

Two processes. The one that has the devices runs a `Desk` and never waits for the other; the other
serves the page to browsers and never touches a device. What goes out are snapshots, of which an
unsent one is replaced by the next; what comes back are the `commands`.
"""
