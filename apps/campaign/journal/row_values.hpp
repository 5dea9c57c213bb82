#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace orbid::apps {

/// The values of a row, wherever it comes from: a statement or a page of a damaged file. Columns count from 0.
class RowValues {
public:
    virtual ~RowValues() = default;
    [[nodiscard]] virtual std::int64_t integer(int column) const = 0;
    /// nan for NULL.
    [[nodiscard]] virtual double real(int column) const = 0;
    [[nodiscard]] virtual bool null(int column) const = 0;
    [[nodiscard]] virtual bool blob(int column) const = 0;
    /// Text or blob, valid as long as the row.
    [[nodiscard]] virtual std::string_view bytes(int column) const = 0;
    [[nodiscard]] std::string text(int column) const { return std::string(bytes(column)); }

protected:
    RowValues() = default;
    RowValues(const RowValues&) = default;
    RowValues& operator=(const RowValues&) = default;
};

}  // namespace orbid::apps
