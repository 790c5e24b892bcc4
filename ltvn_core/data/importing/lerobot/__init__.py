"""LeRobotDataset v2 and v3: rows in parquet files, images in videos or beside the rows."""
