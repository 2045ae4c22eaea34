"""How a study is cut into jobs, and which sources and files each of them depends on."""
