"""The page that shows a result: record and images → pictures and figures → template."""

from acquire.report.page import write_report

__all__ = ["write_report"]
