// SPDX-License-Identifier: Apache-2.0
// The Utah teapot as Martin Newell drew it in 1975 from cubic Bezier patches.
// Source: Frank Crow, "The Origins of the Teapot", IEEE CG&A 7(1), 1987, with the bottom that later
// tables add: 32 patches in all.
#pragma once

#include "clients/cpp/sample/sample_mesh.h"

namespace kdray::client {

/// 32 patches of detail x detail squares: 24 quarters of a turned profile (lid, rim, body, bottom),
/// four each for handle and spout. What the original leaves open is closed here with flat
/// pieces: the gap between lid and rim, and the ends of handle and spout. So there are three closed
/// surfaces (pot, handle, spout), which run into each other as in the original.
/// x from -3 to about 3.43 (handle to spout), y from 0 to 3.15 (up), z from -2 to 2.
SampleMesh MakeTeapot(const SampleOptions& options);

}  // namespace kdray::client
