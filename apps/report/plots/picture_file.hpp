#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace orbid::apps {

/// A picture cannot be turned into the format asked for; the message says what is missing.
class PictureRefused : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

enum class PictureFormat { svg, pdf, png };

/// Turns an SVG picture into a file of its own: PDF with vectors and embedded fonts, or PNG. Both are made by
/// rsvg-convert (librsvg2-bin of Debian), started without a shell; SVG is returned as it is. No creation date is
/// written: the same picture gives the same bytes with the same library.
///
/// @param dots_per_inch  of PNG, > 0.
/// @return bytes of the file.
/// @throws PictureRefused when the program is missing (naming its package) or fails (with what it says).
[[nodiscard]] std::string picture_file(std::string_view svg, PictureFormat format, double dots_per_inch);

}  // namespace orbid::apps
