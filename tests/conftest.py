import os

# before numpy is imported, as the command line does it: small matrices, and perhaps a busy machine
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# models are read, not remembered; the tests of the cache have one of their own
os.environ["VPFRAME_CACHE"] = ""
