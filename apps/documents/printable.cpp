#include "apps/documents/printable.hpp"

#include <algorithm>
#include <cstdint>
#include <streambuf>

#include <fmt/format.h>

namespace orbid::apps {
namespace {

struct Character {
    std::uint32_t code = 0;
    std::size_t length = 0;  ///< bytes; 0: not UTF-8
};

/// The first character of a text that is not empty (RFC 3629: shortest form, no surrogates, up to U+10FFFF).
Character first_character(std::string_view text) {
    const auto byte = [&](std::size_t i) { return static_cast<std::uint32_t>(static_cast<unsigned char>(text[i])); };
    const std::uint32_t first = byte(0);
    if (first < 0x80) return {first, 1};
    const std::size_t length = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
    if (first < 0xC2 || first > 0xF4 || text.size() < length) return {};
    std::uint32_t code = first & (0xFFU >> (length + 1));
    for (std::size_t i = 1; i < length; ++i) {
        if ((byte(i) & 0xC0U) != 0x80U) return {};
        code = code << 6 | (byte(i) & 0x3FU);
    }
    const bool overlong = (length == 3 && code < 0x800) || (length == 4 && code < 0x10000);
    if (overlong || (code >= 0xD800 && code <= 0xDFFF) || code > 0x10FFFF) return {};
    return {code, length};
}

/// Controls, and marks of Unicode that change how the text around them is shown (UAX 9, and the line separators).
bool acts(std::uint32_t code) {
    if (code == '\n' || code == '\t') return false;
    if (code < 0x20 || (code >= 0x7F && code <= 0x9F)) return true;
    return code == 0x061C || code == 0x200E || code == 0x200F || (code >= 0x2028 && code <= 0x202E) ||
           (code >= 0x2066 && code <= 0x2069) || code == 0xFEFF;
}

/// Appends what is printable of a text; the rest of a character that is cut off at its end stays for later.
/// @return how many bytes were used.
std::size_t append_printable(std::string_view text, bool complete, std::string& out) {
    std::size_t at = 0;
    while (at < text.size()) {
        const std::string_view rest = text.substr(at);
        const Character character = first_character(rest);
        if (character.length == 0) {
            const auto first = static_cast<unsigned char>(rest[0]);
            const std::size_t wanted = first >= 0xF0 ? 4 : first >= 0xE0 ? 3 : 2;
            if (!complete && first >= 0xC2 && first <= 0xF4 && rest.size() < wanted) return at;
            out += fmt::format("\\x{:02x}", first);
            ++at;
            continue;
        }
        if (!acts(character.code)) {
            out += rest.substr(0, character.length);
        } else {
            out += fmt::format("\\u{:04x}", character.code);
        }
        at += character.length;
    }
    return at;
}

}  // namespace

std::string printable(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    append_printable(text, true, out);
    return out;
}

std::string visible(std::string_view text) {
    std::string out;
    out.reserve(text.size());
    while (!text.empty()) {
        const Character character = first_character(text);
        if (character.length == 0) {
            out += "\xEF\xBF\xBD";
        } else if (!acts(character.code)) {
            out += text.substr(0, character.length);
        }
        text.remove_prefix(std::max<std::size_t>(character.length, 1));
    }
    return out;
}

class PrintableStream::Buffer final : public std::streambuf {
public:
    explicit Buffer(std::ostream& target) : target_(target) {}
    ~Buffer() override { end(); }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;

    bool pass(std::string_view bytes) {
        end();
        target_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
        return target_.good();
    }

private:
    int_type overflow(int_type character) override {
        if (character == traits_type::eof()) return traits_type::not_eof(character);
        const char c = traits_type::to_char_type(character);
        return xsputn(&c, 1) == 1 ? character : traits_type::eof();
    }
    std::streamsize xsputn(const char* characters, std::streamsize count) override {
        const std::string_view text(characters, static_cast<std::size_t>(count));
        std::string out;
        if (begun_.empty()) {
            begun_ = text.substr(append_printable(text, false, out));
        } else {
            begun_ += text;
            begun_.erase(0, append_printable(begun_, false, out));
        }
        target_.write(out.data(), static_cast<std::streamsize>(out.size()));
        return target_.good() ? count : 0;
    }
    int sync() override {
        target_.flush();
        return target_.good() ? 0 : -1;
    }
    /// A character that was begun is not UTF-8 when something else follows.
    void end() {
        if (begun_.empty()) return;
        const std::string out = printable(begun_);
        begun_.clear();
        target_.write(out.data(), static_cast<std::streamsize>(out.size()));
    }

    std::ostream& target_;
    std::string begun_;
};

PrintableStream::PrintableStream(std::ostream& target)
    : std::ostream(nullptr), buffer_(std::make_unique<Buffer>(target)) {
    rdbuf(buffer_.get());
}

PrintableStream::~PrintableStream() = default;

void PrintableStream::pass(std::string_view bytes) {
    if (!buffer_->pass(bytes)) setstate(std::ios::badbit);
}

void write_unfiltered(std::ostream& stream, std::string_view bytes) {
    if (auto* const filtered = dynamic_cast<PrintableStream*>(&stream)) {
        filtered->pass(bytes);
    } else {
        stream.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    }
}

}  // namespace orbid::apps
