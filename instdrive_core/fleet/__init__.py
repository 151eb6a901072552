"""Many clips trained side by side: a job for each, spread over the cores and GPUs of one machine or a cluster."""
