"""Tests of motiongen: laws and slow twins, one file for each module."""
