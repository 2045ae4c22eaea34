"""A corrected model taken to what people simulate in: URDF, MJCF, and a plain table of parameters."""
