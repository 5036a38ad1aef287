# SPDX-License-Identifier: BSD-3-Clause
raise ImportError("stands for an installation without matplotlib")
