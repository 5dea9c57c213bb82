#pragma once

#include <cstdint>
#include <iosfwd>
#include <string>
#include <string_view>

namespace orbid::apps {

/// Writes a table of CSV cell by cell, to a stream in large pieces.
class CsvLines {
public:
    explicit CsvLines(std::ostream& out) : out_(out) {}

    CsvLines& text(std::string_view value);
    CsvLines& number(std::int64_t value);
    /// As the shortest text that reads back to the same bits; nothing for nan.
    CsvLines& number(double value);
    CsvLines& empty();
    void end_line();
    /// Hands over what is left.
    /// @throws std::runtime_error when the stream takes no more.
    void finish();

private:
    void begin_cell();
    void flush();

    std::ostream& out_;
    std::string buffer_;
    bool line_begins_ = true;
};

}  // namespace orbid::apps
