#pragma once

#include <memory>
#include <ostream>
#include <string>
#include <string_view>

namespace orbid::apps {

/// Text that does nothing to a terminal or an editor but show itself. Escaped are: control characters other than
/// newline and tab (`\u001b`), those of C1 and those that turn the direction of writing or hide (`\u202e`), and bytes
/// that are not UTF-8 (`\xff`).
[[nodiscard]] std::string printable(std::string_view text);

/// The same for pages and pictures: such characters are left out, and bytes that are not UTF-8
/// become the replacement character U+FFFD.
[[nodiscard]] std::string visible(std::string_view text);

/// A stream that writes to another one what printable() makes of it. Flushing passes on, and so do failures.
///
/// Names, titles and paths come from strangers' files; this stands between all of them and the terminal.
class PrintableStream final : public std::ostream {
public:
    explicit PrintableStream(std::ostream& target);
    ~PrintableStream() override;

    /// Writes bytes as they are.
    void pass(std::string_view bytes);

private:
    class Buffer;
    std::unique_ptr<Buffer> buffer_;
};

/// Writes bytes past the filter of a PrintableStream, or to any other stream: colours, a picture. What comes from
/// outside must have been made printable before.
void write_unfiltered(std::ostream& stream, std::string_view bytes);

}  // namespace orbid::apps
