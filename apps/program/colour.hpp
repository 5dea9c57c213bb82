#pragma once

#include <cstdio>
#include <string>
#include <string_view>
#include <vector>

namespace orbid::apps {

/// Values of --color.
[[nodiscard]] std::vector<std::string> colour_choices();

/// Whether text for a stream is coloured: "always", "never", or "auto": on a terminal with colours (TERM is not "dumb",
/// nullptr is none) unless the environment has a nonempty NO_COLOR.
[[nodiscard]] bool is_coloured(std::string_view choice, std::FILE* stream);

/// A message with its first part, up to ": " (a place, the program), in red; the same text where `coloured` is false.
/// The message is made printable(); what comes is written by write_unfiltered().
[[nodiscard]] std::string error_text(const std::string& raw, bool coloured);

/// A summary with the statuses at the beginning of lines ("converged: ...") in green, or in red if not converged.
/// Made printable() and written as above.
[[nodiscard]] std::string with_status_colours(const std::string& raw, bool coloured);

}  // namespace orbid::apps
