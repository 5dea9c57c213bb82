#include "orbits/records/matlab_file.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <map>
#include <memory>
#include <optional>
#include <string_view>

#include <dlfcn.h>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <matio.h>

#include "orbits/records/data_file.hpp"
#include "orbits/records/library_function.hpp"
#include "orbits/records/nearest_name.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {
namespace {

/// The matio library is loaded on first use, as that of HDF5 is, on which it depends.
void* matio_symbol(const char* name) {
    static void* const handle = ::dlopen(ORBID_MATIO_LIBRARY, RTLD_NOW | RTLD_LOCAL);
    return library_symbol(handle, ORBID_MATIO_LIBRARY, name, "Matlab");
}

template <class Function>
using MatioFunction = LibraryFunction<Function, matio_symbol>;

constexpr MatioFunction<decltype(::Mat_Close)> Mat_Close{"Mat_Close"};
constexpr MatioFunction<decltype(::Mat_Open)> Mat_Open{"Mat_Open"};
constexpr MatioFunction<decltype(::Mat_VarFree)> Mat_VarFree{"Mat_VarFree"};
constexpr MatioFunction<decltype(::Mat_VarGetStructFieldByName)> Mat_VarGetStructFieldByName{
    "Mat_VarGetStructFieldByName"};
constexpr MatioFunction<decltype(::Mat_VarGetStructFieldnames)> Mat_VarGetStructFieldnames{
    "Mat_VarGetStructFieldnames"};
constexpr MatioFunction<decltype(::Mat_VarGetNumberOfFields)> Mat_VarGetNumberOfFields{"Mat_VarGetNumberOfFields"};
constexpr MatioFunction<decltype(::Mat_VarRead)> Mat_VarRead{"Mat_VarRead"};
constexpr MatioFunction<decltype(::Mat_VarReadNextInfo)> Mat_VarReadNextInfo{"Mat_VarReadNextInfo"};

struct CloseFile {
    void operator()(mat_t* file) const { Mat_Close(file); }
};
struct FreeVariable {
    void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};
using Variable = std::unique_ptr<matvar_t, FreeVariable>;

bool is_structure(const matvar_t& variable) {
    return variable.class_type == MAT_C_STRUCT && variable.rank == 2 && variable.dims[0] == 1 && variable.dims[1] == 1;
}

/// Real numbers in one or two dimensions.
bool is_numeric(const matvar_t& variable) {
    return variable.class_type >= MAT_C_DOUBLE && variable.class_type <= MAT_C_UINT64 && variable.isComplex == 0 &&
           variable.rank == 2 && variable.dims[0] > 0 && variable.dims[1] > 0;
}

bool is_vector(const matvar_t& variable) {
    return variable.dims[0] == 1 || variable.dims[1] == 1;
}

double number_at(const matvar_t& variable, std::size_t index) {
    const auto as = [&]<class Number>(Number) {
        return static_cast<double>(static_cast<const Number*>(variable.data)[index]);
    };
    switch (variable.class_type) {
        case MAT_C_SINGLE:
            return as(float{});
        case MAT_C_INT8:
            return as(std::int8_t{});
        case MAT_C_UINT8:
            return as(std::uint8_t{});
        case MAT_C_INT16:
            return as(std::int16_t{});
        case MAT_C_UINT16:
            return as(std::uint16_t{});
        case MAT_C_INT32:
            return as(std::int32_t{});
        case MAT_C_UINT32:
            return as(std::uint32_t{});
        case MAT_C_INT64:
            return as(std::int64_t{});
        case MAT_C_UINT64:
            return as(std::uint64_t{});
        default:
            return as(double{});
    }
}

/// A name of a column: "run.y(:,2)".
struct ColumnName {
    std::string variable;  ///< "run.y"
    std::optional<std::size_t> column, row;

    explicit ColumnName(std::string_view text) : variable(text.substr(0, text.find('('))) {
        std::string_view index = text.substr(variable.size());
        const auto number = [](std::string_view digits) -> std::optional<std::size_t> {
            std::size_t value = 0;
            const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
            if (error != std::errc{} || end != digits.data() + digits.size()) return std::nullopt;
            return value;
        };
        if (index.starts_with("(:,") && index.ends_with(')')) column = number(index.substr(3, index.size() - 4));
        if (index.starts_with('(') && index.ends_with(",:)")) row = number(index.substr(1, index.size() - 4));
        if (!index.empty() && !column && !row) variable = text;  // no such name exists
    }
};

/// Vectors, and the columns or rows of matrices, whichever are longer.
struct Listing {
    std::vector<std::string> names;  ///< in the order of the file
    std::vector<std::size_t> lengths;

    void add(const std::string& name, matvar_t& variable) {
        if (is_structure(variable)) {
            char* const* fields = Mat_VarGetStructFieldnames(&variable);
            for (unsigned i = 0; i < Mat_VarGetNumberOfFields(&variable); ++i)
                if (matvar_t* field = Mat_VarGetStructFieldByName(&variable, fields[i], 0); field != nullptr)
                    add(fmt::format("{}.{}", name, fields[i]), *field);
        } else if (is_numeric(variable) && is_vector(variable)) {
            names.push_back(name);
            lengths.push_back(std::max(variable.dims[0], variable.dims[1]));
        } else if (is_numeric(variable)) {
            const bool standing = variable.dims[0] >= variable.dims[1];
            for (std::size_t j = 1; j <= std::min(variable.dims[0], variable.dims[1]); ++j) {
                names.push_back(standing ? fmt::format("{}(:,{})", name, j) : fmt::format("{}({},:)", name, j));
                lengths.push_back(std::max(variable.dims[0], variable.dims[1]));
            }
        }
    }

    [[nodiscard]] std::vector<std::string> longest() const {
        const std::size_t length = *std::max_element(lengths.begin(), lengths.end());
        std::vector<std::string> chosen;
        for (std::size_t i = 0; i < names.size(); ++i)
            if (lengths[i] == length) chosen.push_back(names[i]);
        return chosen;
    }
};

class MatlabFile {
public:
    explicit MatlabFile(const std::filesystem::path& path) : path_(path) {
        const std::string name = path.string();
        (void)require_data_file(path);
        // Variables are read by names in any order; matio finds them from the beginning only.
        const auto file = open();
        while (const Variable variable{Mat_VarReadNextInfo(file.get())})
            if (variable->name != nullptr) listing_.add(variable->name, *variable);
        refuse_record_if(listing_.names.empty(), "{}: holds no vector or matrix of real numbers", name);
    }

    [[nodiscard]] const Listing& listing() const { return listing_; }

    [[nodiscard]] std::vector<double> column(const std::string& text) {
        const ColumnName name(text);
        const matvar_t& variable = find(name.variable, text);
        refuse_record_if(!is_numeric(variable), "{}: \"{}\" is no vector or matrix of real numbers", path_.string(),
                         text);
        const std::size_t rows = variable.dims[0], columns = variable.dims[1];
        refuse_record_if(
            !name.column && !name.row && !is_vector(variable),
            "{}: \"{}\" is a matrix of {} x {}: name one of its columns, \"{}(:,1)\", or rows, \"{}(1,:)\"",
            path_.string(), text, rows, columns, text, text);
        refuse_record_if((name.column && (*name.column < 1 || *name.column > columns)) ||
                             (name.row && (*name.row < 1 || *name.row > rows)),
                         "{}: there is no \"{}\": {} has {} x {} numbers", path_.string(), text, name.variable, rows,
                         columns);
        std::vector<double> numbers;
        const std::size_t first = name.column ? (*name.column - 1) * rows : name.row ? *name.row - 1 : 0;
        const std::size_t stride = name.row ? rows : 1;
        const std::size_t length = name.column ? rows : name.row ? columns : rows * columns;
        for (std::size_t i = 0; i < length; ++i)
            numbers.push_back(number_at(variable, first + i * stride));
        return numbers;
    }

private:
    [[nodiscard]] std::unique_ptr<mat_t, CloseFile> open() const {
        std::unique_ptr<mat_t, CloseFile> file(Mat_Open(path_.c_str(), MAT_ACC_RDONLY));
        refuse_record_if(!file, "{}: is no Matlab file", path_.string());
        return file;
    }

    /// A variable, or a field within structures. Read once.
    const matvar_t& find(const std::string& path, const std::string& text) {
        const std::string top = path.substr(0, path.find('.'));
        auto& read = variables_[top];
        if (!read) read.reset(Mat_VarRead(open().get(), top.c_str()));
        matvar_t* variable = read.get();
        for (std::size_t at = top.size(); variable != nullptr && at < path.size();) {
            const std::size_t end = std::min(path.find('.', at + 1), path.size());
            variable = is_structure(*variable)
                           ? Mat_VarGetStructFieldByName(variable, path.substr(at + 1, end - at - 1).c_str(), 0)
                           : nullptr;
            at = end;
        }
        if (variable == nullptr || (variable->data == nullptr && is_numeric(*variable))) {
            const auto nearest = nearest_name(text, listing_.names);
            refuse_record_if(true, "{}: no variable \"{}\"{}; there are {}", path_.string(), text,
                             nearest ? fmt::format(" (did you mean \"{}\"?)", *nearest) : "",
                             shown_names(listing_.names));
        }
        return *variable;
    }

    std::filesystem::path path_;
    Listing listing_;
    std::map<std::string, Variable> variables_;
};

}  // namespace

bool is_matlab_file(const std::filesystem::path& file) {
    return file.extension() == ".mat" || file.extension() == ".MAT";
}

std::string matlab_table(const std::filesystem::path& path, const std::vector<std::string>& names) {
    MatlabFile file(path);
    const std::vector<std::string> header = names.empty() ? file.listing().longest() : names;
    std::vector<std::vector<double>> columns;
    for (const std::string& name : header) {
        columns.push_back(file.column(name));
        refuse_record_if(columns.back().size() != columns.front().size(),
                         "{}: \"{}\" has {} numbers, \"{}\" has {}: columns of a table must have one length",
                         path.string(), name, columns.back().size(), header.front(), columns.front().size());
    }
    fmt::memory_buffer text;
    for (std::size_t c = 0; c < header.size(); ++c)
        fmt::format_to(std::back_inserter(text), "{}\"{}\"", c == 0 ? "" : ",", header[c]);
    for (std::size_t row = 0; row < columns.front().size(); ++row) {
        text.push_back('\n');
        for (std::size_t c = 0; c < columns.size(); ++c) {
            if (c > 0) text.push_back(',');
            const double number = columns[c][row];
            // A quoted empty cell: a line without any character would be skipped.
            if (std::isnan(number)) {
                text.append(std::string_view("\"\""));
            } else {
                fmt::format_to(std::back_inserter(text), "{}", number);
            }
        }
    }
    return fmt::to_string(text);
}

}  // namespace orbid::orbits
