"""Broken files, full disks and kills: what the program does about them."""
