"""The .rrd recording: the log, the dataset, the map and the replay. The only home of rerun."""
