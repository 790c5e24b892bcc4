"""LeRobotDataset v3: rows in parquet files, images in videos or beside the rows."""
