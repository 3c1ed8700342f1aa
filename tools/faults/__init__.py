"""The fault campaign, and the spoilt and paced lines that it and the tests use."""
