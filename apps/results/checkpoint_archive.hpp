#pragma once

#include <array>
#include <complex>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include <Eigen/Core>

namespace orbid::apps {

/// Stored bytes end early or hold impossible sizes: they were not written by this program.
class DamagedCheckpoint : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

/// Values to bytes and back, bit by bit. One function per type gives the same order for writing and reading.
///
/// Numbers are in the format of this machine: a checkpoint is continued where it was made. A function `fields(archive,
/// value)` passes all members of a struct to the archive.
class Archive {
public:
    /// Appends to `bytes`.
    explicit Archive(std::string& bytes) : written_(&bytes) {}
    /// Reads from `bytes`.
    explicit Archive(std::string_view bytes) : left_(bytes) {}

    [[nodiscard]] bool reading() const { return written_ == nullptr; }
    /// Whether nothing is left to read.
    [[nodiscard]] bool at_end() const { return left_.empty(); }

    /// Reads a text without copying it. @throws DamagedCheckpoint when there are too few bytes.
    [[nodiscard]] std::string_view text() {
        const std::string_view found = left_.substr(0, count(0, 1));
        left_.remove_prefix(found.size());
        return found;
    }

    /// @throws DamagedCheckpoint when reading finds too few bytes.
    template <class... T>
    void operator()(T&... values) {
        (transfer(values), ...);
    }

private:
    void bytes(void* data, std::size_t size) {
        if (size == 0) return;
        if (!reading()) {
            written_->append(static_cast<const char*>(data), size);
            return;
        }
        if (left_.size() < size) throw DamagedCheckpoint("a checkpoint ends early");
        std::memcpy(data, left_.data(), size);
        left_.remove_prefix(size);
    }

    /// The number of elements; each takes at least `smallest` bytes, so that no wrong number exhausts the memory.
    std::size_t count(std::size_t size, std::size_t smallest) {
        std::uint64_t stored = size;
        bytes(&stored, sizeof(stored));
        if (reading() && stored * smallest > left_.size()) throw DamagedCheckpoint("a checkpoint holds a wrong size");
        return static_cast<std::size_t>(stored);
    }

    template <class T>
    void transfer(T& value) {
        if constexpr (std::is_same_v<T, bool>) {
            std::uint8_t stored = value ? 1 : 0;
            bytes(&stored, sizeof(stored));
            if (stored > 1) throw DamagedCheckpoint("a checkpoint holds what is neither true nor false");
            value = stored == 1;
        } else if constexpr (std::is_enum_v<T>) {
            bytes(&value, sizeof(T));
            constexpr int most = 64;  // more than any enumeration of ours has
            if (static_cast<long long>(value) < 0 || static_cast<long long>(value) >= most)
                throw DamagedCheckpoint("a checkpoint holds an unknown kind");
        } else if constexpr (std::is_arithmetic_v<T>) {
            bytes(&value, sizeof(T));
        } else {
            fields(*this, value);
        }
    }
    void transfer(std::string& text) {
        text.resize(count(text.size(), 1));
        bytes(text.data(), text.size());
    }
    template <class T>
    void transfer(std::complex<T>& value) {
        bytes(&value, sizeof(value));
    }
    template <class T>
    void transfer(std::vector<T>& list) {
        const std::size_t size = count(list.size(), 1);
        if (!reading()) {
            for (T& value : list)
                transfer(value);
            return;
        }
        // One by one: a wrong number of large elements meets the end of the bytes before it exhausts the memory.
        list.clear();
        for (std::size_t i = 0; i < size; ++i)
            transfer(list.emplace_back());
    }
    template <class T, std::size_t N>
    void transfer(std::array<T, N>& list) {
        for (T& value : list)
            transfer(value);
    }
    template <class First, class Second>
    void transfer(std::pair<First, Second>& both) {
        transfer(both.first);
        transfer(both.second);
    }
    template <class T>
    void transfer(std::optional<T>& value) {
        bool there = value.has_value();
        transfer(there);
        if (!there) return;
        if (!value) value.emplace();
        transfer(*value);
    }
    template <class... T>
    void transfer(std::variant<T...>& value) {
        std::size_t index = value.index();
        transfer(index);
        if (index >= sizeof...(T)) throw DamagedCheckpoint("a checkpoint holds an unknown kind");
        std::size_t place = 0;
        if (index != value.index()) ((place++ == index ? static_cast<void>(value = T{}) : void()), ...);
        std::visit([&](auto& one) { transfer(one); }, value);
    }
    template <int Rows, int Columns>
    void transfer(Eigen::Matrix<double, Rows, Columns>& matrix) {
        std::uint64_t rows = static_cast<std::uint64_t>(matrix.rows());
        std::uint64_t columns = static_cast<std::uint64_t>(matrix.cols());
        bytes(&rows, sizeof(rows));
        bytes(&columns, sizeof(columns));
        if (reading()) {
            // A vector of no rows takes no bytes, whatever its columns.
            const std::uint64_t most = left_.size() / sizeof(double);
            constexpr std::uint64_t longest = std::uint64_t{1} << 40;
            const bool fixed = (Rows == Eigen::Dynamic || rows == static_cast<std::uint64_t>(Rows)) &&
                               (Columns == Eigen::Dynamic || columns == static_cast<std::uint64_t>(Columns));
            if (!fixed || (columns > 0 && rows > most / columns) || rows > longest || columns > longest)
                throw DamagedCheckpoint("a checkpoint holds a wrong size");
            matrix.resize(static_cast<Eigen::Index>(rows), static_cast<Eigen::Index>(columns));
        }
        bytes(matrix.data(), static_cast<std::size_t>(matrix.size()) * sizeof(double));
    }

    std::string* written_ = nullptr;
    std::string_view left_;
};

}  // namespace orbid::apps
