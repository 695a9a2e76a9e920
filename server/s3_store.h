// SPDX-License-Identifier: Apache-2.0
// The adaptor to S3 and what speaks its protocol: core's ObjectStore over the signed requests of
// server/s3_requests.h. No other file knows S3's answers.
#pragma once

#include <memory>

#include "core/base/result.h"
#include "core/store/object_store.h"
#include "server/aws_settings.h"

namespace kdray::server {

/// Requests are made by the calling threads, each over a connection that is kept. A connection must
/// be made within 3 s; a request that moves less than a kilobyte in 5 s is given up. Bodies are
/// signed with their SHA-256. Signatures follow the store's clock: if this machine's is off, the
/// first request is sent twice. If the store has no conditional writes, PutMode::kKeep replaces.
///
/// kInvalidArgument if `settings` fails.
core::Result<std::unique_ptr<core::ObjectStore>> MakeS3Store(const StoreUrl& url,
                                                             SettingsSource settings);

}  // namespace kdray::server
