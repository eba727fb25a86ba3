"""A file a question: what two meshes, or two objects, are to each other."""
