"""The backend by which pip installs `tools`: setuptools, in the folder above."""

import os

from setuptools.build_meta import *  # noqa: F403

os.chdir(os.pardir)
