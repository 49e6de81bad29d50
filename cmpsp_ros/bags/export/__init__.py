"""Bags as tables for pandas and spreadsheets."""

from cmpsp_ros.bags.export.files import export
