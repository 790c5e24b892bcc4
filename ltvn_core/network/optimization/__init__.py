"""Training and fine-tuning loops: batches, one step, hard-negative mining, calibration of r."""
