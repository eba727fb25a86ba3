import os

# before numpy is imported, as the command line does it: small matrices, and perhaps a busy machine
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
