#pragma once

#include <string>

#include "apps/program/command.hpp"

namespace orbid::apps {

/// The manual page orbid(1), in troff's man macros, made from the table of commands.
[[nodiscard]] std::string manual_page();

/// orbid man: the page on standard output.
[[nodiscard]] int show_manual_page(const CommandCall& call);

}  // namespace orbid::apps
