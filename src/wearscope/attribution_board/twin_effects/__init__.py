"""The twin's own torques as effects that the simulator can load: the truth beside which a study is set."""
