"""Commands for people who look after this repository: conversions of committed files. No part of the packages."""
