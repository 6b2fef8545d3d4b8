"""Who works: this process, or Ray workers. One loop over jobs, one rule for lost workers. It knows no dataset and no simulator."""
