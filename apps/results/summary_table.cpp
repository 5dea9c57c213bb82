#include "apps/results/summary_table.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

/// Decimal exponent: 1 for 12.3, -3 for 0.0012.
int exponent(double value) {
    return static_cast<int>(std::floor(std::log10(std::abs(value))));
}

}  // namespace

std::size_t shown_width(std::string_view text) {
    // Bytes 10xxxxxx continue a character.
    return static_cast<std::size_t>(
        std::count_if(text.begin(), text.end(), [](char c) { return (static_cast<unsigned char>(c) & 0xC0) != 0x80; }));
}

std::string significant(double value, int digits) {
    return std::isnan(value) ? "" : fmt::format("{:.{}g}", value, digits);
}

std::string percent(double relative) {
    return std::isnan(relative) ? "" : fmt::format("{:+.3g} %", 100.0 * relative);
}

std::string with_digits_of(double value, double sd) {
    if (std::isnan(value)) return "undefined";
    if (!(sd > 0.0) || !std::isfinite(sd) || !std::isfinite(value)) return fmt::format("{:.6g}", value);
    constexpr int most_digits = 15;  // of a double; a smaller sd says more than the number holds
    const int last = exponent(sd) - 1;
    const int first = value == 0.0 ? last : std::max(exponent(value), last);
    const int digits = std::min(first - last, most_digits);  // after the first one
    // Plain decimals from 0.001 to a million read best; beyond that an exponent saves zeros.
    if (first >= -3 && first < 6) return fmt::format("{:.{}f}", value, std::clamp(digits - first, 0, most_digits + 3));
    return fmt::format("{:.{}e}", value, digits);
}

void SummaryTable::add(Row cells) {
    if (cells.size() != columns_.size())
        throw std::invalid_argument(
            fmt::format("table: {} cells, must be {}, one per column", cells.size(), columns_.size()));
    rows_.push_back(std::move(cells));
}

bool SummaryTable::shows(std::size_t column) const {
    return std::any_of(rows_.begin(), rows_.end(), [column](const Row& row) { return !row[column].text.empty(); });
}

std::string SummaryTable::text() const {
    if (rows_.empty()) return "";
    std::vector<std::size_t> widths(columns_.size(), 0);
    for (std::size_t c = 0; c < columns_.size(); ++c) {
        if (shows(c)) widths[c] = shown_width(columns_[c].heading);
        for (const Row& row : rows_)
            widths[c] = std::max(widths[c], shown_width(row[c].text));
    }
    std::string out;
    const auto line = [&](const auto& cell_of) {
        std::string text;
        for (std::size_t c = 0; c < columns_.size(); ++c) {
            if (widths[c] == 0) continue;
            const std::string& cell = cell_of(c);
            const std::string blanks(widths[c] - shown_width(cell), ' ');
            text += "  " + (columns_[c].align == Align::left ? cell + blanks : blanks + cell);
        }
        text.erase(text.find_last_not_of(' ') + 1);
        out += text + '\n';
    };
    line([&](std::size_t c) -> const std::string& { return columns_[c].heading; });
    for (const Row& row : rows_)
        line([&](std::size_t c) -> const std::string& { return row[c].text; });
    return out;
}

std::string titled(std::string_view heading, const std::string& body) {
    return body.empty() ? "" : fmt::format("\n{}\n{}", heading, body);
}

}  // namespace orbid::apps
