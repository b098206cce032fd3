"""lumisplit: the application that captures, records, separates, decomposes and reports."""

import os

# Its threads wait by counting: on matrices as small as ours they cost a processor each and save
# nothing. Work is shared out among threads elsewhere. Read when numpy is first imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
