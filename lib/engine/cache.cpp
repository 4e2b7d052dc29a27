// SPDX-License-Identifier: Apache-2.0
#include "rayloom/engine/cache.h"

#include "rayloom/core/error.h"

#include <OpenImageIO/hash.h>

#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>

namespace rayloom
{

namespace fs = std::filesystem;

namespace
{

/// First bytes of an entry; the pixels follow at `offset`, rows of channels of floats.
struct Header {
    char magic[8] = {'r', 'a', 'y', 'l', 'o', 'o', 'm', '1'};
    std::int32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0, channels = 0, unused = 0;
    std::uint64_t checksum = 0;
};
constexpr std::size_t offset = 64;
static_assert(sizeof(Header) <= offset);

std::size_t payload_bytes(const Region& window, int channels)
{
    return window.pixels() * static_cast<std::size_t>(channels) * sizeof(float);
}

/// Of an entry's content under its name: a file that came to another entry's name is damaged.
std::uint64_t checksum_of(const std::string& path, const void* data, std::size_t bytes)
{
    const std::string name = fs::path(path).filename().string();
    return OIIO::xxhash::XXH64(data, bytes, OIIO::xxhash::XXH64(name.data(), name.size(), 1));
}

/// A file mapped for reading or writing.
class Mapping
{
public:
    static std::unique_ptr<Mapping> read(const std::string& path)
    {
        // Not to wait where somebody made a pipe of that name.
        const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
        if (fd < 0) return nullptr;
        struct stat info {
        };
        std::unique_ptr<Mapping> m;
        if (::fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_size > 0)
            m = map(fd, static_cast<std::size_t>(info.st_size), PROT_READ);
        ::close(fd);
        return m;
    }
    static std::unique_ptr<Mapping> create(const std::string& path, std::size_t size)
    {
        const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
        if (fd < 0) return nullptr;
        std::unique_ptr<Mapping> m;
        // Blocks are reserved at once: a full disk is an error here, not a SIGBUS later.
        if (::posix_fallocate(fd, 0, static_cast<off_t>(size)) == 0)
            m = map(fd, size, PROT_READ | PROT_WRITE);
        ::close(fd);
        if (!m) ::unlink(path.c_str());
        return m;
    }
    ~Mapping() { ::munmap(m_data, m_size); }
    Mapping(const Mapping&) = delete;
    Mapping& operator=(const Mapping&) = delete;
    char* data() const { return static_cast<char*>(m_data); }
    std::size_t size() const { return m_size; }

private:
    Mapping(void* data, std::size_t size) : m_data(data), m_size(size) {}
    static std::unique_ptr<Mapping> map(int fd, std::size_t size, int protection)
    {
        void* data = ::mmap(nullptr, size, protection, MAP_SHARED, fd, 0);
        if (data == MAP_FAILED) return nullptr;
        return std::unique_ptr<Mapping>(new Mapping(data, size));
    }
    void* m_data;
    std::size_t m_size;
};

/// Hands out the pixels of the entries of one item.
class CachedImages final : public Node
{
public:
    struct Entry {
        std::string port;
        std::unique_ptr<Mapping> mapping;
        ConstImageView view;
    };
    explicit CachedImages(std::vector<Entry> entries) : m_entries(std::move(entries)) {}
    void plan(PlanContext&) override {}
    void compute(const TileContext& context) const override
    {
        for (const Entry& entry : m_entries)
            if (context.wants(entry.port)) copy_pixels(entry.view, context.output(entry.port));
    }

private:
    std::vector<Entry> m_entries;
};

constexpr const char *image_ending = ".image", *totals_ending = ".totals",
                     *temporary_ending = ".tmp";

std::string temporary_name(const std::string& path)
{
    static std::atomic<unsigned> counter{0};
    return path + temporary_ending + std::to_string(::getpid()) + "." + std::to_string(counter++);
}

/// An entry that was used becomes the last that trim_cache() removes. (File systems are often
/// mounted so that reading leaves no trace.)
void mark_used(const std::string& path) { ::utimensat(AT_FDCWD, path.c_str(), nullptr, 0); }

} // namespace

struct CacheWriter::State {
    std::string path, temporary;
    Region window;
    int channels = 0;
    std::unique_ptr<Mapping> mapping;
    std::atomic<std::size_t> written{0};
};

CacheWriter::CacheWriter(std::string path, const Region& window, int channels)
    : m_state(std::make_unique<State>())
{
    m_state->temporary = temporary_name(path);
    m_state->path = std::move(path);
    m_state->window = window;
    m_state->channels = channels;
    m_state->mapping =
        Mapping::create(m_state->temporary, offset + payload_bytes(window, channels));
}

CacheWriter::~CacheWriter()
{
    if (m_state->mapping) ::unlink(m_state->temporary.c_str());
}

void CacheWriter::write(ConstImageView tile)
{
    if (!m_state->mapping) return;
    const Region& w = m_state->window;
    const ImageView to(reinterpret_cast<float*>(m_state->mapping->data() + offset), w,
                       m_state->channels,
                       static_cast<std::ptrdiff_t>(w.width()) * m_state->channels, w.width());
    copy_pixels(tile, to.crop(tile.region()));
    m_state->written += tile.region().pixels();
}

void CacheWriter::commit()
{
    State& s = *m_state;
    if (!s.mapping || s.written != s.window.pixels()) return;
    Header header;
    header.x0 = s.window.x0;
    header.y0 = s.window.y0;
    header.x1 = s.window.x1;
    header.y1 = s.window.y1;
    header.channels = s.channels;
    header.checksum = checksum_of(s.path, s.mapping->data() + offset, s.mapping->size() - offset);
    std::memcpy(s.mapping->data(), &header, sizeof header);
    s.mapping.reset();
    if (::rename(s.temporary.c_str(), s.path.c_str()) != 0) ::unlink(s.temporary.c_str());
}

Cache::Cache(std::string folder) : m_folder(std::move(folder))
{
    std::error_code status;
    fs::create_directories(m_folder, status);
    if (status || !fs::is_directory(m_folder, status))
        throw OutputError(
            "cache folder '" + m_folder + "' cannot be made: " +
            (status ? status.message() : std::string("something else has that name")));
}

std::string Cache::path(const std::string& key, const char* suffix) const
{
    return m_folder + "/" + key + suffix;
}

std::unique_ptr<CacheWriter> Cache::writer(const std::string& key, const Region& window,
                                           int channels) const
{
    return std::make_unique<CacheWriter>(path(key, image_ending), window, channels);
}

std::shared_ptr<const Node> Cache::find(const std::vector<CachedOutput>& outputs,
                                        const Region& window) const
{
    std::vector<CachedImages::Entry> entries;
    for (const CachedOutput& output : outputs) {
        const std::string file = path(output.key, image_ending);
        std::unique_ptr<Mapping> mapping = Mapping::read(file);
        if (!mapping) return nullptr;
        Header header;
        const Header expected;
        bool good = mapping->size() == offset + payload_bytes(window, output.channels);
        if (good) {
            std::memcpy(&header, mapping->data(), sizeof header);
            good = std::equal(std::begin(header.magic), std::end(header.magic),
                              std::begin(expected.magic)) &&
                   Region{header.x0, header.y0, header.x1, header.y1} == window &&
                   header.channels == output.channels &&
                   header.checksum ==
                       checksum_of(file, mapping->data() + offset, mapping->size() - offset);
        }
        if (!good) {
            ::unlink(file.c_str());
            return nullptr;
        }
        mark_used(file);
        const ConstImageView view(
            reinterpret_cast<const float*>(mapping->data() + offset), window, output.channels,
            static_cast<std::ptrdiff_t>(window.width()) * output.channels, window.width());
        entries.push_back({output.port, std::move(mapping), view});
    }
    return std::make_shared<CachedImages>(std::move(entries));
}

void Cache::store_totals(const std::string& key, const std::vector<double>& totals) const
{
    const std::string file = path(key, totals_ending), temporary = temporary_name(file);
    const std::size_t bytes = totals.size() * sizeof(double);
    const std::uint64_t checksum = checksum_of(file, totals.data(), bytes);
    {
        std::ofstream out(temporary, std::ios::binary);
        out.write(reinterpret_cast<const char*>(&checksum), sizeof checksum);
        out.write(reinterpret_cast<const char*>(totals.data()),
                  static_cast<std::streamsize>(bytes));
        if (!out.flush()) {
            ::unlink(temporary.c_str());
            return;
        }
    }
    if (::rename(temporary.c_str(), file.c_str()) != 0) ::unlink(temporary.c_str());
}

std::optional<std::vector<double>> Cache::find_totals(const std::string& key) const
{
    const std::string file = path(key, totals_ending);
    std::error_code ignored;
    if (!fs::is_regular_file(file, ignored)) return std::nullopt;
    std::ifstream in(file, std::ios::binary | std::ios::ate);
    if (!in) return std::nullopt;
    const auto size = static_cast<std::size_t>(in.tellg());
    std::uint64_t checksum = 0;
    std::vector<double> totals(size >= sizeof checksum ? (size - sizeof checksum) / sizeof(double)
                                                       : 0);
    in.seekg(0);
    in.read(reinterpret_cast<char*>(&checksum), sizeof checksum);
    in.read(reinterpret_cast<char*>(totals.data()),
            static_cast<std::streamsize>(totals.size() * sizeof(double)));
    if (!in || size != sizeof checksum + totals.size() * sizeof(double) ||
        checksum != checksum_of(file, totals.data(), totals.size() * sizeof(double))) {
        ::unlink(file.c_str());
        return std::nullopt;
    }
    mark_used(file);
    return totals;
}

void trim_cache(const std::string& folder, std::size_t bytes)
{
    struct Entry {
        fs::file_time_type used;
        std::uintmax_t size;
        fs::path path;
    };
    std::vector<Entry> entries;
    std::uintmax_t total = 0;
    std::error_code status;
    // Nobody writes a single entry for a day.
    const auto abandoned = fs::file_time_type::clock::now() - std::chrono::hours(24);
    for (fs::directory_iterator it(folder, status), end; !status && it != end;
         it.increment(status)) {
        std::error_code gone; // another process may be removing, too
        const Entry entry{it->last_write_time(gone), it->file_size(gone), it->path()};
        if (gone) continue;
        const std::string ending = entry.path.extension().string();
        if (entry.path.filename().string().find(temporary_ending) != std::string::npos) {
            if (entry.used < abandoned) fs::remove(entry.path, gone);
        } else if (ending == image_ending || ending == totals_ending) {
            total += entry.size;
            entries.push_back(entry);
        }
    }
    std::ranges::sort(entries, {}, &Entry::used);
    for (const Entry& entry : entries) {
        if (total <= bytes) break;
        fs::remove(entry.path, status);
        total -= entry.size;
    }
}

void apply_cache(Plan& plan, const std::string& folder)
{
    const Cache cache(folder);
    for (WorkItem& item : plan.items) {
        const PlannedOp& op = plan.ops[static_cast<std::size_t>(item.op)];
        if (!item.needed || item.inputs.empty() || op.result.sink || op.result.cheap) continue;
        // Wanted outputs come back together or not at all.
        std::vector<CachedOutput> outputs;
        bool storable = true;
        for (const WorkItem::Output& out : item.outputs) {
            if (!out.wanted) continue;
            const Stream& stream = plan.streams[static_cast<std::size_t>(out.stream)];
            storable = storable && stream.kind != PortKind::deep;
            outputs.push_back({stream.key(), out.port, stream.desc.channel_count()});
        }
        if (!storable || outputs.empty()) continue;
        item.source = cache.find(outputs, item.window);
        if (item.source) plan.pruned.push_back({op.id, "its result is in the cache"});
    }
    for (PlannedOp& op : plan.ops)
        if (op.needed && op.result.reduction) {
            op.cached_totals = cache.find_totals(op.key);
            if (op.cached_totals && op.cached_totals->size() != op.result.reduction->values)
                op.cached_totals.reset();
        }
}

} // namespace rayloom
