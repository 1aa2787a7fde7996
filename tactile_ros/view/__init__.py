# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Live views of frames, contacts and grip: a page in the browser, and Foxglove."""
