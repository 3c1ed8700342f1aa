"""DATAQ instruments: ASCII commands and a binary stream on a serial port."""
