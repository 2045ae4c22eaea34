"""Will a fault detector find joint wear, and can the simulator that says so be trusted."""
