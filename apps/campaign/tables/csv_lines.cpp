#include "apps/campaign/tables/csv_lines.hpp"

#include <array>
#include <charconv>
#include <cmath>
#include <ostream>
#include <stdexcept>

#include "apps/results/result_file.hpp"

namespace orbid::apps {
namespace {

template <class Number>
void append_number(std::string& buffer, Number value) {
    std::array<char, 32> digits;
    const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr;
    buffer.append(digits.data(), end);
}

}  // namespace

void CsvLines::begin_cell() {
    if (!line_begins_) buffer_ += ',';
    line_begins_ = false;
}

CsvLines& CsvLines::text(std::string_view value) {
    begin_cell();
    if (value.find_first_of(",\"\r\n") == std::string_view::npos) {
        buffer_ += value;
    } else {
        buffer_ += csv_cell(std::string(value));
    }
    return *this;
}

CsvLines& CsvLines::number(std::int64_t value) {
    begin_cell();
    append_number(buffer_, value);
    return *this;
}

CsvLines& CsvLines::number(double value) {
    begin_cell();
    if (!std::isnan(value)) append_number(buffer_, value);
    return *this;
}

CsvLines& CsvLines::empty() {
    begin_cell();
    return *this;
}

void CsvLines::end_line() {
    buffer_ += '\n';
    line_begins_ = true;
    constexpr std::size_t piece = std::size_t{1} << 20;
    if (buffer_.size() >= piece) flush();
}

void CsvLines::flush() {
    out_.write(buffer_.data(), static_cast<std::streamsize>(buffer_.size()));
    if (!out_) throw std::runtime_error("the table cannot be written: the disk is full, or nobody reads it");
    buffer_.clear();
}

void CsvLines::finish() {
    flush();
    out_.flush();
    if (!out_) throw std::runtime_error("the table cannot be written: the disk is full, or nobody reads it");
}

}  // namespace orbid::apps
