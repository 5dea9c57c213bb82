#include "apps/campaign/journal/journal_pages.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <system_error>

#include <fmt/format.h>

#include "apps/campaign/journal/journal.hpp"
#include "apps/campaign/journal/journal_tables.hpp"

namespace orbid::apps {
namespace {

constexpr std::size_t page_size = journal_page;

std::uint64_t big_endian(std::string_view bytes, std::size_t at, std::size_t size) {
    std::uint64_t value = 0;
    for (std::size_t k = 0; k < size; ++k)
        value = value << 8 | static_cast<unsigned char>(bytes[at + k]);
    return value;
}

/// Moves `at` behind the number; nothing when the bytes end before it.
std::optional<std::uint64_t> varint(std::string_view bytes, std::size_t& at) {
    std::uint64_t value = 0;
    for (int k = 0; k < 9 && at < bytes.size(); ++k) {
        const auto byte = static_cast<unsigned char>(bytes[at++]);
        if (k == 8) return value << 8 | byte;
        value = value << 7 | (byte & 0x7f);
        if (byte < 0x80) return value;
    }
    return {};
}

/// The running checksum of a write-ahead log.
class LogChecksum {
public:
    explicit LogChecksum(bool big) : big_(big) {}
    void add(std::string_view bytes) {
        for (std::size_t k = 0; k + 8 <= bytes.size(); k += 8) {
            first_ += word(bytes, k) + second_;
            second_ += word(bytes, k + 4) + first_;
        }
    }
    /// Whether the eight bytes at `at` say the same.
    [[nodiscard]] bool agrees(std::string_view bytes, std::size_t at) const {
        return big_endian(bytes, at, 4) == first_ && big_endian(bytes, at + 4, 4) == second_;
    }

private:
    [[nodiscard]] std::uint32_t word(std::string_view bytes, std::size_t at) const {
        const auto value = static_cast<std::uint32_t>(big_endian(bytes, at, 4));
        return big_ ? value : __builtin_bswap32(value);
    }
    bool big_;
    std::uint32_t first_ = 0;
    std::uint32_t second_ = 0;
};

std::string read_at(std::ifstream& file, std::int64_t place, std::size_t size) {
    std::string bytes(size, '\0');
    file.clear();
    file.seekg(place);
    file.read(bytes.data(), static_cast<std::streamsize>(size));
    bytes.resize(static_cast<std::size_t>(std::max<std::streamsize>(file.gcount(), 0)));
    return bytes;
}

}  // namespace

JournalPages::JournalPages(const std::filesystem::path& file) : file_(file, std::ios::binary) {
    std::error_code none;
    const auto size = std::filesystem::file_size(file, none);
    if (!file_ || none) throw JournalError(fmt::format("cannot read {}", file.string()));
    count_ = static_cast<std::int64_t>((size + page_size - 1) / page_size);
    auto log = file;
    log += "-wal";
    read_log(log);
}

void JournalPages::read_log(const std::filesystem::path& log) {
    log_.open(log, std::ios::binary);
    if (!log_) return;
    const std::string header = read_at(log_, 0, 32);
    if (header.size() < 32 || (big_endian(header, 0, 4) & ~1U) != 0x377f0682 || big_endian(header, 8, 4) != page_size)
        return;
    LogChecksum checksum((big_endian(header, 0, 4) & 1) != 0);
    checksum.add(std::string_view(header).substr(0, 24));
    if (!checksum.agrees(header, 24)) return;
    std::unordered_map<std::int64_t, std::int64_t> uncommitted;
    for (std::int64_t place = 32;; place += 24 + static_cast<std::int64_t>(page_size)) {
        const std::string frame = read_at(log_, place, 24 + page_size);
        if (frame.size() < 24 + page_size || frame.compare(8, 8, header, 16, 8) != 0) return;
        checksum.add(std::string_view(frame).substr(0, 8));
        checksum.add(std::string_view(frame).substr(24));
        if (!checksum.agrees(frame, 16)) return;
        uncommitted[static_cast<std::int64_t>(big_endian(frame, 0, 4))] = place + 24;
        const auto pages = static_cast<std::int64_t>(big_endian(frame, 4, 4));
        if (pages == 0) continue;
        for (const auto& [page, at] : uncommitted)
            in_log_[page] = at;
        uncommitted.clear();
        count_ = std::max(count_, pages);
    }
}

std::string JournalPages::page(std::int64_t number) {
    if (number < 1 || number > count_) return {};
    if (const auto found = in_log_.find(number); found != in_log_.end()) return read_at(log_, found->second, page_size);
    return read_at(file_, (number - 1) * static_cast<std::int64_t>(page_size), page_size);
}

bool PageRow::read(std::string record, bool has_key, std::int64_t key) {
    record_ = std::move(record);
    has_key_ = has_key;
    key_ = key;
    columns_.clear();
    std::size_t at = 0;
    const auto header = varint(record_, at);
    if (!header || *header > record_.size() || *header < at) return false;
    std::size_t begin = *header;
    while (at < *header) {
        const auto serial = varint(std::string_view(record_).substr(0, *header), at);
        if (!serial || *serial == 10 || *serial == 11) return false;
        constexpr std::array<std::size_t, 10> sizes{0, 1, 2, 3, 4, 6, 8, 8, 0, 0};
        const std::uint64_t size = *serial < sizes.size() ? sizes[*serial] : (*serial - 12) / 2;
        if (size > record_.size() - begin) return false;
        columns_.push_back({*serial, begin, static_cast<std::size_t>(size)});
        begin += static_cast<std::size_t>(size);
    }
    return !columns_.empty() && begin == record_.size();
}

std::int64_t PageRow::integer(int column) const {
    if (column == 0 && has_key_) return key_;
    const Column& c = columns_[static_cast<std::size_t>(column)];
    if (c.type == 8 || c.type == 9) return static_cast<std::int64_t>(c.type - 8);
    if (c.type == 0 || c.type > 6) return 0;
    const auto value = static_cast<std::int64_t>(big_endian(record_, c.begin, c.size) << (64 - 8 * c.size));
    return value >> (64 - 8 * c.size);
}

double PageRow::real(int column) const {
    const Column& c = columns_[static_cast<std::size_t>(column)];
    if (c.type == 7) return std::bit_cast<double>(big_endian(record_, c.begin, 8));
    // Whole numbers are stored as integers, shorter.
    if (c.type != 0 && c.type <= 9) return static_cast<double>(integer(column));
    return std::numeric_limits<double>::quiet_NaN();
}

std::string_view PageRow::bytes(int column) const {
    const Column& c = columns_[static_cast<std::size_t>(column)];
    return c.type >= 12 ? std::string_view(record_).substr(c.begin, c.size) : std::string_view();
}

namespace {

/// Part of a record that is on its page; the rest is on a chain of further pages. Section 1.6 of the source.
std::size_t local_size(std::uint64_t payload, bool table) {
    const std::size_t largest = table ? page_size - 35 : (page_size - 12) * 64 / 255 - 23;
    if (payload <= largest) return static_cast<std::size_t>(payload);
    const std::size_t least = (page_size - 12) * 32 / 255 - 23;
    const std::size_t size = least + static_cast<std::size_t>((payload - least) % (page_size - 4));
    return size <= largest ? size : least;
}

/// The record that begins at `at` of a page; nothing when it is not whole.
std::optional<std::string> record_at(JournalPages& pages, std::string_view page, std::size_t at, std::uint64_t payload,
                                     bool table) {
    const std::size_t local = local_size(payload, table);
    if (payload > static_cast<std::uint64_t>(pages.count()) * page_size || local > page.size() - at) return {};
    std::string record(page.substr(at, local));
    if (payload == local) return record;
    if (page.size() - at - local < 4) return {};
    auto next = static_cast<std::int64_t>(big_endian(page, at + local, 4));
    while (record.size() < payload) {
        const std::string further = pages.page(next);
        if (further.size() < page_size) return {};
        record += further.substr(4, std::min<std::size_t>(page_size - 4, payload - record.size()));
        next = static_cast<std::int64_t>(big_endian(further, 0, 4));
    }
    return record;
}

/// The row of a cell; false when there is none.
bool read_cell(JournalPages& pages, std::string_view page, std::size_t at, unsigned char kind, PageRow& row) {
    if (kind == 0x02) at += 4;
    const auto payload = varint(page, at);
    if (!payload) return false;
    std::uint64_t key = 0;
    if (kind == 0x0d) {
        const auto found = varint(page, at);
        if (!found) return false;
        key = *found;
    }
    if (at > page.size()) return false;
    auto record = record_at(pages, page, at, *payload, kind == 0x0d);
    return record && row.read(std::move(*record), kind == 0x0d, static_cast<std::int64_t>(key));
}

}  // namespace

void each_page_row(JournalPages& pages, const std::function<bool(const PageRow&)>& use) {
    PageRow row;
    for (std::int64_t number = 1; number <= pages.count(); ++number) {
        const std::string page = pages.page(number);
        const std::size_t header = number == 1 ? 100 : 0;
        if (page.size() < header + 12) continue;
        const auto kind = static_cast<unsigned char>(page[header]);
        if (kind != 0x02 && kind != 0x0a && kind != 0x0d) continue;
        const std::size_t first = header + (kind == 0x02 ? 12 : 8);
        const auto cells = static_cast<std::size_t>(big_endian(page, header + 3, 2));
        for (std::size_t k = 0; k < cells && first + 2 * k + 2 <= page.size(); ++k) {
            const auto at = static_cast<std::size_t>(big_endian(page, first + 2 * k, 2));
            if (at >= page.size()) continue;
            if (read_cell(pages, page, at, kind, row) && !use(row)) return;
        }
    }
}

}  // namespace orbid::apps
