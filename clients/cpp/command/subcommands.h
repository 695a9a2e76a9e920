// The subcommands. Each function adds one to `app`; it runs while CLI11 parses. `session` must live
// as long as `app`.
#pragma once

#include <CLI/CLI.hpp>

#include "clients/cpp/command/session.h"

namespace kdray::client {

void AddUpload(CLI::App& app, Session& session);        ///< upload
void AddRender(CLI::App& app, Session& session);        ///< render
void AddRays(CLI::App& app, Session& session);          ///< rays
void AddTreeCommands(CLI::App& app, Session& session);  ///< list, show, delete, cells, mesh
void AddTradeoff(CLI::App& app, Session& session);      ///< tradeoff
void AddSamples(CLI::App& app, Session& session);       ///< sample, sample-rays

}  // namespace kdray::client
