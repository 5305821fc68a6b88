from .step import first_run as first_run, report_step as report_step
