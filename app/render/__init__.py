"""Drawing and picking: a renderer on OpenGL, one on the CPU, and the view that uses either."""
