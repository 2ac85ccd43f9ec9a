# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Runs commands as a user whom the system does not know, and who may not write everywhere."""

import subprocess

USER = 54321
# Also root has only the permissions of a file's owner then.
AS_UNKNOWN_USER = ['unshare', '--user', f'--map-user={USER}', f'--map-group={USER}']


def why_not():
    """Return why this machine cannot do so; an empty text if it can."""
    try:
        done = subprocess.run([*AS_UNKNOWN_USER, 'true'], capture_output=True, text=True)
    except FileNotFoundError:
        return 'unshare (util-linux) is not installed'
    return done.stderr.strip()
