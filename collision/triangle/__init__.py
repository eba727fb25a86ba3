"""Two triangles: whether they meet, how far they are apart, how far one may move."""
